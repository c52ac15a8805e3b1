"""omnisight detect."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json
from omnisight.cli._progress import progress
from omnisight.pipeline.options import DetectOptions

GROUP = "Calibration"

DEFAULT_FOLDER = Path("omnisight-detect")


def detect(
    images: list[str],
    /,
    *,
    options: Annotated[DetectOptions, Parameter(name="*")] = DetectOptions(),
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
) -> None:
    """Detect the board in images and draw the detections, without calibrating.

    Copies of the images are written with the corners drawn, their order, the magnified uncertainty ellipse of each
    corner, and the border of the image field.

    Parameters
    ----------
    images
        Images and video clips: folders, files or patterns such as 'left*.jpg'. Of a clip the most informative frames
        are used.
    output
        Folder for the drawings; omnisight-detect by default, or no drawings with --json.
    """
    from functools import partial

    from omnisight.cli._detect_report import as_json, print_report
    from omnisight.images import collect_images
    from omnisight.images.output_paths import drawing_paths
    from omnisight.pipeline.detect import detect as run
    from omnisight.report.drawings.detections import draw_detections

    folder = output if output is not None or is_json() else DEFAULT_FOLDER
    if folder is not None:
        drawing_paths(collect_images(images, videos=True), folder)
    with progress() as report:
        detections = run(images, options, progress=report)
        if all(image.size is None for image in detections.images):
            notes = [f"  {image.note}" for image in detections.images[:5]]
            raise ValueError("\n".join(["none of the images can be read:", *notes]))
        if is_json():
            as_json(detections)
        else:
            print_report(detections)
        if folder is not None:
            files = drawing_paths([image.path for image in detections.images], folder)
            draw_detections(detections, files, apply_exif=options.apply_exif, progress=partial(report, "draw"))
    if folder is not None:
        print(f"drawn     {folder}")
