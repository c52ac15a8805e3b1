"""omnisight detect."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json, write_json
from omnisight.cli._progress import progress
from omnisight.pipeline.batch.batch_options import BatchOptions
from omnisight.pipeline.detection.detect_options import DetectOptions

GROUP = "Calibration"

DEFAULT_FOLDER = "omnisight-detect"


def detect(
    images: list[str],
    /,
    *,
    options: Annotated[DetectOptions, Parameter(name="*")] = DetectOptions(),
    output: Annotated[str | None, Parameter(alias="-o")] = None,
    batch: Annotated[BatchOptions, Parameter(name="*")] = BatchOptions(),
) -> None:
    """Detect the board in images and draw the detections, without calibrating.

    Copies of the images are written with the corners drawn, their order, the magnified uncertainty ellipse of each
    corner, and the border of the image field.

    Parameters
    ----------
    images
        Images and video clips: folders, files or patterns such as 'left*.jpg'. Of a clip the most informative frames
        are used. With --workers, --cluster or a URL one folder with its sub-folders, or a pattern.
    output
        Folder for the drawings; omnisight-detect by default, or no drawings with --json. With --workers, --cluster or a
        URL, folder for corners.json, which has what --json prints, without drawings.
    """
    if batch.apply_to(*images, output or ""):
        _detect_batch(images, output, options, batch)
        return
    from functools import partial

    from omnisight.cli._detect_report import print_report, print_table
    from omnisight.images import collect_images
    from omnisight.images.output_paths import drawing_paths
    from omnisight.pipeline.detection.detect import detect as run
    from omnisight.pipeline.detection.detection_advice import list_notes
    from omnisight.report.drawings.detections import draw_detections

    folder = None if output is None and is_json() else Path(output or DEFAULT_FOLDER)
    if folder is not None:
        drawing_paths(collect_images(images, videos=True), folder)
    with progress() as report:
        detections = run(images, options, progress=report)
        if all(image.size is None for image in detections.images):
            raise ValueError("\n".join(["none of the images can be read:", *list_notes(detections)]))
        if is_json():
            from omnisight.corners.native import to_dict  # the package imports all readers of cameras and corners

            write_json(to_dict(detections))
        else:
            print_table(detections)
            print_report(detections)
        if folder is not None:
            files = drawing_paths([image.path for image in detections.images], folder)
            draw_detections(detections, files, apply_exif=options.apply_exif, progress=partial(report, "draw"))
    if folder is not None:
        print(f"drawn     {folder}")


def _detect_batch(images: list[str], output: str | None, options: DetectOptions, batch: BatchOptions) -> None:
    """Detect by workers, and print the result."""
    from omnisight.cli._batch_report import check_batch, print_batch
    from omnisight.cli._detect_report import print_report
    from omnisight.corners.native import to_dict
    from omnisight.pipeline.batch.batch import Batch
    from omnisight.pipeline.detection.detect_batch import detect_batch

    if len(images) > 1 or output is None:
        raise ValueError("--workers, --cluster and URLs apply to one folder or pattern of images, and need --output")
    with progress() as report:
        detections, result = detect_batch(images[0], Batch(output, batch, report), options)
    if is_json():
        write_json(to_dict(detections))
    else:
        print_report(detections)
        print_batch(result, output)
    check_batch(result)
