"""omnisight calibrate-rig."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._progress import progress
from omnisight.pipeline.calibrate_rig_options import CalibrateRigOptions


def calibrate_rig(
    cameras: list[str],
    /,
    *,
    options: Annotated[CalibrateRigOptions, Parameter(name="*")] = CalibrateRigOptions(),
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    json: bool = False,
    quiet: bool = False,
    verbose: Annotated[bool, Parameter(alias="-v")] = False,
) -> None:
    """Calibrate several rigidly connected cameras, and their poses relative to each other.

    Show a board to two or more cameras at the same time, in many poses. Cameras of any model can be mixed; every camera
    must be connected with the others by common boards, directly or through other cameras.

    Parameters
    ----------
    cameras
        The images of each camera: a folder, a clip, or a pattern such as 'left*.jpg', whose name is the name of the
        camera; or NAME=IMAGES.
    output
        Rig file to write (JSON); by default rig.json, which must not exist, or none with --json.
    json
        Print one JSON object and nothing else.
    quiet
        Show no progress.
    verbose
        Print all reasons and timings.
    """
    from omnisight.cli._files import check_camera_suffix, default_output, must_be_writable
    from omnisight.cli._rig_report import print_json, print_report
    from omnisight.formats import save
    from omnisight.pipeline.calibrate_rig import calibrate_rig as run

    if output is None and not json:
        output = default_output("rig.json")
    if output is not None:
        must_be_writable(output)
        check_camera_suffix(output)
    with progress(quiet or json) as show:
        calibration = run(cameras, options, progress=show)
    written = None if output is None else save(calibration.rig, output).path
    if json:
        print_json(calibration)
    else:
        print_report(calibration, written, verbose=verbose)
