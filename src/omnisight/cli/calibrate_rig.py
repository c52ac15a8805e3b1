"""omnisight calibrate-rig."""

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json
from omnisight.cli._progress import progress
from omnisight.pipeline.rig_calibration.calibrate_rig_options import CalibrateRigOptions

GROUP = "Calibration"


def calibrate_rig(
    cameras: list[str],
    /,
    *,
    options: Annotated[CalibrateRigOptions, Parameter(name="*")] = CalibrateRigOptions(),
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    draw: Path | None = None,
    report: Path | None = None,
) -> None:
    """Calibrate several rigidly connected cameras, and their poses relative to each other.

    Show a board to two or more cameras at the same time, in many poses. Cameras of any model can be mixed; every camera
    must be connected with the others by common boards, directly or through other cameras.

    Parameters
    ----------
    cameras
        The images of each camera: a folder, a clip, or a pattern such as 'left*.jpg', whose name is the name of the
        camera; or NAME=IMAGES. Or one folder with a sub-folder or a clip for each camera, or with numbered images such
        as left1.jpg and right1.jpg.
    output
        Rig file to write (JSON); by default rig.json, which must not exist, or none with --json.
    draw
        Folder for copies of the images with corners and residuals drawn, in a folder for each camera.
    report
        HTML report to write: verdict, rig in 3-D, fields of view, residuals, and the rig in every format.
    """
    from omnisight.cli._files import check_calibration_outputs, check_camera_suffix, default_output, save_calibrated
    from omnisight.cli._rig_report import print_json, print_report
    from omnisight.images.output_paths import drawing_paths, refuse_overwrite
    from omnisight.pipeline.detection.detect import source_paths
    from omnisight.pipeline.rig_calibration.calibrate_rig import calibrate_rig as run
    from omnisight.pipeline.rig_calibration.rig_sources import named_sources

    if output is None and not is_json():
        output = default_output("rig.json")
    files = check_calibration_outputs(output, report, "rig")
    paths = {name: source_paths([source]) for name, source in named_sources(cameras).items()}
    others = [*options.target, *options.camera_files.values(), *([options.times] if options.times else [])]
    refuse_overwrite(files, [*(path for found in paths.values() for path in found), *others])
    if output is not None:
        check_camera_suffix(output)
    if draw is not None:
        for name, found in paths.items():
            drawing_paths(found, draw / name)
    with progress() as show:
        calibration = run(cameras, options, progress=show)
    written, failure = save_calibrated(calibration.rig, output)
    if is_json():
        print_json(calibration)
    else:
        print_report(calibration, written and written.path)
    if failure is not None:
        raise failure
    if draw is not None:
        from omnisight.cli._drawings import draw_rig_calibration

        draw_rig_calibration(calibration, draw, apply_exif=options.apply_exif)
    if report is not None:
        from omnisight.report.report_data import ReportOptions
        from omnisight.report.rigs.page import write_rig_report

        command = ["omnisight", *sys.argv[1:]]
        write_rig_report(calibration, report, ReportOptions(command, apply_exif=options.apply_exif))
        print(f"report    {report}")
