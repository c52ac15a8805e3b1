"""omnisight next."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json
from omnisight.cli._progress import progress
from omnisight.pipeline.calibration.calibrate_options import NextViewOptions

GROUP = "Calibration"


def next(
    images: list[str],
    /,
    *,
    camera: Path,
    options: Annotated[NextViewOptions, Parameter(name="*")] = NextViewOptions(),
    draw: Annotated[Path | None, Parameter(alias="-o")] = None,
) -> None:
    """Propose where to hold the board for the next calibration image.

    About two thousand board placements are evaluated. The one that reduces the worst projection uncertainty most is
    proposed; further proposals assume that the earlier images were taken. Without `--pattern` or `--target`, the board
    is that of the camera file.

    Parameters
    ----------
    images
        Images and clips that the camera was calibrated from: folders, files or patterns; or corner files, as for
        `omnisight calibrate`.
    camera
        Camera file of any format: the result of this calibration.
    draw
        Image file to write: the proposed boards and the uncertainty, over one of the images or an empty frame.
    """
    from omnisight.cli._next_report import print_json, print_report
    from omnisight.images.output_paths import refuse_overwrite
    from omnisight.pipeline.calibration.next_view import next_view as run
    from omnisight.pipeline.detection.detect import is_corner_source, source_paths

    if draw is not None:
        paths = source_paths(images)
        refuse_overwrite([draw], paths)
        _check_drawing_file(draw, [] if is_corner_source(images) else paths)
    with progress() as report:
        proposal = run(images, camera, options, progress=report)
    detections = proposal.detections
    assert detections is not None
    if draw is not None:  # a corner file may name images
        refuse_overwrite([draw], [image.path for image in detections.images])
    if is_json():
        print_json(proposal, detections)
    else:
        print_report(proposal, detections)
    if draw is not None:
        from omnisight.report.drawings.next_view import draw_proposal

        draw_proposal(proposal, detections, draw, apply_exif=options.apply_exif)
        print(f"drawn     {draw}")


def _check_drawing_file(draw: Path, images: Sequence[Path]) -> None:
    """Raise `ValueError` if the drawing cannot be written, or would be read as an image of the set later."""
    from omnisight.images.output_paths import check_folder_of

    if draw.is_dir():
        raise ValueError(f"{draw}: is a folder; name an image in it, such as {draw / 'next.png'}")
    check_folder_of(draw)
    if draw.parent.resolve() in {path.parent.resolve() for path in images}:
        raise ValueError(f"{draw}: its folder holds the images, so the drawing would be read as one; use another")
    if draw.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise ValueError(f"{draw}: a drawing is a .png or .jpg, not {draw.suffix or 'without an extension'}")
