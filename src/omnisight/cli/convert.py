"""omnisight convert."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json

GROUP = "Cameras"


def convert(
    camera: list[Path],
    /,
    *,
    to: str,
    model: str | None = None,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    name: str | None = None,
    distance: str | None = None,
    max_theta: float | None = None,
    max_error: float = 1.0,
    force: bool = False,
    invert_extrinsics: bool = False,
    flip: bool = False,
) -> None:
    """Write a camera or a rig in another format, in another camera model if necessary, and print the error.

    Parameters
    ----------
    camera
        A calibration file of any format; or several with the poses of cameras relative to the same IMU, such as
        Kalibr's camchain-imucam files, which are joined to one rig.
    to
        The format to write: native, ocamcalib, opencv, kalibr, colmap ...
    model
        The camera model to convert to. By default the camera's own if the format holds it, otherwise the most accurate
        model of the format.
    output
        The file to write; by default in the folder of the input.
    name
        The camera to convert if the file holds several; by default the rig of all of them.
    distance
        The distance of the scene from a non-central camera, with its unit (2m, or inf). The central camera that fits
        there is written.
    max_theta
        Fit only up to this angle from the axis, degrees, instead of the calibrated field of view.
    max_error
        The largest error with which a file is written, px.
    force
        Write the file whatever its error.
    invert_extrinsics
        Of a rig: use the inverse of the poses in the file; `inspect --images` checks them.
    flip
        Exchange left and right of the camera frame: a camera that looks into one mirror, if it was calibrated with
        boards without markers, and is used together with other cameras. Its views then need no --flip.
    """
    from omnisight.cli._convert_report import (
        print_conversion,
        print_json,
        print_refusal_json,
        print_report,
        print_rig_report,
    )
    from omnisight.formats import is_rig_file
    from omnisight.pipeline.convert import ConversionError, ConvertOptions
    from omnisight.pipeline.convert import convert as convert_file
    from omnisight.pipeline.convert_rig import ConvertRigResult, convert_rig

    options = ConvertOptions(to, model, output, name, distance, max_theta, max_error, force, invert_extrinsics, flip)
    if len(camera) > 1 and name is not None:
        raise ValueError(
            f"--name {name}: {len(camera)} files are joined to one rig: leave the name out, or convert one"
        )
    is_rig = len(camera) > 1 or (name is None and is_rig_file(camera[0]))
    try:
        result = convert_rig(camera, options) if is_rig else convert_file(camera[0], options)
    except ConversionError as error:
        if is_json():
            print_refusal_json(error, options)
        print_conversion(error.source, error.conversion, None if is_rig else distance)
        raise
    if is_json():
        print_json(result, options)
    elif isinstance(result, ConvertRigResult):
        print_rig_report(result, options)
    else:
        print_report(result, distance)
