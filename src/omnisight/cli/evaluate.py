"""omnisight evaluate."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json
from omnisight.cli._progress import progress
from omnisight.pipeline.calibration.calibrate_options import EvaluateOptions

GROUP = "Calibration"


def evaluate(
    camera: Path,
    images: list[str],
    /,
    *,
    options: Annotated[EvaluateOptions, Parameter(name="*")] = EvaluateOptions(),
    name: str | None = None,
    compare: list[Path] | None = None,
    draw: Path | None = None,
) -> None:
    """Evaluate a calibrated camera on other images of a board, or on other corners.

    The camera is unchanged; only the board poses and the board warp are estimated. Corners are used as first detected
    or read, without a re-detection pass.

    Parameters
    ----------
    camera
        Camera file of any format.
    images
        Images and clips that the camera was not calibrated from: folders, files or patterns; or corner files, as for
        `omnisight calibrate`.
    name
        Name of the camera, if its file holds several.
    compare
        File of another camera to evaluate on the same corners; may be repeated.
    draw
        Folder for copies of the images with corners and residuals drawn.
    """
    from omnisight.cli._evaluate_report import print_json, print_report
    from omnisight.formats import load
    from omnisight.images.output_paths import drawing_paths, image_labels
    from omnisight.pipeline.calibration.evaluate import evaluate as run
    from omnisight.pipeline.detection.detect import source_paths

    files = list({path.resolve(): path for path in [camera, *(compare or [])]}.values())
    cameras = {
        label: load(path, name=name) if path == camera else load(path, option=None)
        for label, path in zip(image_labels(files), files, strict=True)
    }
    if draw is not None:
        drawing_paths(source_paths(images), draw)
    with progress() as report:
        evaluations = run(cameras, images, options, progress=report)
    if is_json():
        print_json(evaluations)
    else:
        print_report(evaluations)
    if draw is not None:
        from omnisight.cli._drawings import draw_evaluation

        draw_evaluation(next(iter(evaluations.values())), draw, apply_exif=options.apply_exif)
