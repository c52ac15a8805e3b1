"""omnisight calibrate."""

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json
from omnisight.cli._progress import progress
from omnisight.pipeline.calibration.calibrate_options import CalibrateOptions

GROUP = "Calibration"


def calibrate(
    images: list[str],
    /,
    *,
    options: Annotated[CalibrateOptions, Parameter(name="*")] = CalibrateOptions(),
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    draw: Path | None = None,
    report: Path | None = None,
) -> None:
    """Calibrate a camera from images of a board, or from corners that another program detected.

    No initial guess of focal length, field of view or centre is needed. Fields of view from 60 to 280 degrees work.

    Parameters
    ----------
    images
        Images and video clips: folders, files or patterns such as 'left*.jpg'. Of a clip the most informative frames
        are used. Or corner files: .mat of BabelCalib, MATLAB or OCamCalib, .orpc of Deltille, .vnl of mrcal, points in
        OpenCV's YAML or XML or in .npz, or the output of `omnisight detect --json`.
    output
        Camera file to write (JSON); by default camera.json, which must not exist, or none with --json.
    draw
        Folder for copies of the images with corners and residuals drawn.
    report
        HTML report to write: verdict, residuals of every image, uncertainty, and the camera in every format.
    """
    from omnisight.cli._calibrate_report import print_json, print_report
    from omnisight.cli._files import check_calibration_outputs, check_camera_suffix, default_output, save_calibrated
    from omnisight.formats import save
    from omnisight.images.output_paths import drawing_paths, refuse_overwrite
    from omnisight.pipeline.calibration.calibrate import calibrate as run
    from omnisight.pipeline.calibration.interruption import CalibrationInterrupted
    from omnisight.pipeline.detection.detect import source_paths

    if output is None and not is_json():
        output = default_output("camera.json")
    files = check_calibration_outputs(output, report, "camera")
    paths = source_paths(images)
    refuse_overwrite(files, [*paths, *(file for file in (options.target, options.start) if file is not None)])
    if output is not None:
        check_camera_suffix(output)
    if draw is not None:
        drawing_paths(paths, draw)
    try:
        with progress() as show:
            calibration = run(images, options, progress=show)
    except CalibrationInterrupted as interrupted:
        if output is not None:
            written = save(interrupted.camera, output).path
            print(f"written   {written}: the best camera so far, its accuracy was not assessed", file=sys.stderr)
        raise
    written, failure = save_calibrated(calibration.camera, output)
    if is_json():
        print_json(calibration)
    else:
        print_report(calibration, written)
    if failure is not None:
        raise failure
    if draw is not None:
        from omnisight.cli._drawings import draw_calibration

        draw_calibration(calibration, draw, apply_exif=options.apply_exif)
    if report is not None:
        from omnisight.report.page import write_report
        from omnisight.report.report_data import ReportOptions

        write_report(calibration, report, ReportOptions(["omnisight", *sys.argv[1:]], apply_exif=options.apply_exif))
        print(f"report    {report}")
