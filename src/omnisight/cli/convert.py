"""omnisight convert."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

if TYPE_CHECKING:
    from omnisight.camera import Camera
    from omnisight.conversion import Conversion
    from omnisight.formats import SaveResult
    from omnisight.pipeline.convert import ConvertOptions

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
        The file to write; by default beside the input.
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
    """
    from omnisight.formats import is_rig_file
    from omnisight.pipeline.convert import ConversionError, ConvertOptions
    from omnisight.pipeline.convert import convert as convert_file

    options = ConvertOptions(to, model, output, name, distance, max_theta, max_error, force, invert_extrinsics)
    if len(camera) > 1 and name is not None:
        raise ValueError(
            f"--name {name}: {len(camera)} files are joined to one rig: leave the name out, or convert one"
        )
    if len(camera) > 1 or (name is None and is_rig_file(camera[0])):
        _convert_rig(camera, options)
        return
    try:
        result = convert_file(camera[0], options)
    except ConversionError as error:
        _print_conversion(error.source, error.conversion, distance)
        raise
    _print_conversion(result.source, result.conversion, distance)
    _print_written(result.written, result.convention)


def _convert_rig(paths: list[Path], options: "ConvertOptions") -> None:
    from omnisight.pipeline.convert import ConversionError
    from omnisight.pipeline.convert_rig import convert_rig

    try:
        result = convert_rig(paths, options)
    except ConversionError as error:
        _print_conversion(error.source, error.conversion, None)
        raise
    rig = result.source
    width = max(6, *map(len, rig.names))
    print(f"{'camera':<{width}}  {'model':<42}  error px  error deg")
    for name, camera, conversion in zip(rig.names, rig.cameras, result.conversions, strict=True):
        if conversion is None:
            print(f"{name:<{width}}  {f'{camera.model.name}, unchanged':<42}  {0:8}  {0:9}")
            continue
        model = f"{camera.model.name} -> {conversion.camera.model.name}"
        print(f"{name:<{width}}  {model:<42}  {conversion.max_px:8.3g}  {conversion.max_deg:9.3g}")
    if options.invert_extrinsics:
        print("poses       inverted")
    _print_written(result.written, result.convention, rig.unit)


def _print_written(written: "SaveResult", convention: str, unit: str | None = None) -> None:
    poses = "" if unit is None else f", {written.rotation_deg:.2g} deg, {written.translation:.2g} {unit}"
    print(f"written     {written.path}; reads back within {written.error_px:.2g} px{poses}")
    print(f"convention  {convention}")
    for note in written.notes:
        print(f"note        {note}")


def _print_conversion(source: "Camera", conversion: "Conversion | None", distance: str | None) -> None:
    import math

    if distance is not None:
        fit = source.provenance["central_of"]
        print(f"central     {source.model.name}, at most {fit['differs_px']:.2g} px off at {distance}")
        if fit.get("mirrored"):
            print(
                "frame       at the viewpoint of the mirror; left and right are exchanged as in the image (view --flip)"
            )
    if conversion is None:
        print(f"model       {source.model.name}, unchanged")
        return
    print(f"model       {source.model.name} -> {conversion.camera.model.name}")
    print(f"fitted      up to {math.degrees(conversion.theta_max):.1f} degrees from the axis")
    print(f"error       at most {conversion.max_px:.3g} px, {conversion.max_deg:.3g} deg; ", end="")
    print(f"rms {conversion.rms_px:.3g} px, {conversion.rms_deg:.3g} deg")
    print(f"agreement   within 0.5 px up to {math.degrees(conversion.agreement_theta):.1f} degrees from the axis")
