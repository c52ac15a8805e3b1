"""omnisight convert."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json
from omnisight.pipeline.conversion.convert_options import ConvertOptions

GROUP = "Cameras"


@dataclass(frozen=True, kw_only=True)
class _ConvertOptions(ConvertOptions):
    """Options of a conversion.

    Attributes
    ----------
    format
        The format to write: native, ocamcalib, opencv, kalibr, colmap ...
    """

    format: Annotated[str, Parameter(name="--to")] = field()  # required, unlike in Python
    output: Annotated[Path | None, Parameter(alias="-o")] = None
    max_theta_deg: Annotated[float | None, Parameter(name="--max-theta")] = None
    max_error_px: Annotated[float, Parameter(name="--max-error")] = ConvertOptions.max_error_px


def convert(camera: list[Path], /, *, options: Annotated[_ConvertOptions, Parameter(name="*")]) -> None:
    """Write a camera or a rig in another format, in another camera model if necessary, and print the error.

    Parameters
    ----------
    camera
        A calibration file of any format; or several with the poses of cameras relative to the same IMU, such as
        Kalibr's camchain-imucam files, which are joined to one rig.
    """
    from omnisight.cli._convert_report import (
        print_conversion,
        print_json,
        print_refusal_json,
        print_report,
        print_rig_report,
    )
    from omnisight.formats import is_rig_file
    from omnisight.pipeline.conversion.convert import ConversionError
    from omnisight.pipeline.conversion.convert import convert as convert_file
    from omnisight.pipeline.conversion.convert_rig import ConvertRigResult, convert_rig

    if len(camera) > 1 and options.name is not None:
        raise ValueError(
            f"--name {options.name}: {len(camera)} files are joined to one rig: leave the name out, or convert one"
        )
    is_rig = len(camera) > 1 or (options.name is None and is_rig_file(camera[0]))
    try:
        result = convert_rig(camera, options) if is_rig else convert_file(camera[0], options)
    except ConversionError as error:
        if is_json():
            print_refusal_json(error, options)
        print_conversion(error.source, error.conversion, None if is_rig else options.distance)
        raise
    if is_json():
        print_json(result, options)
    elif isinstance(result, ConvertRigResult):
        print_rig_report(result, options)
    else:
        print_report(result, options.distance)
