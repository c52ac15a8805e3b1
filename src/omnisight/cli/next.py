"""omnisight next."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._progress import progress


def next(
    images: list[str],
    /,
    *,
    camera: Path,
    pattern: Annotated[str | None, Parameter(alias="--size")] = None,
    square: str | None = None,
    target: Path | None = None,
    name: str | None = None,
    image_size: str | None = None,
    which: str | None = None,
    count: int = 3,
    draw: Annotated[Path | None, Parameter(alias="-o")] = None,
    apply_exif: bool = False,
    cache: bool = True,
    json: bool = False,
    quiet: bool = False,
) -> None:
    """Propose where to hold the board for the next calibration image.

    About two thousand board placements are evaluated. The one that reduces the worst projection uncertainty most is
    proposed; further proposals assume that the earlier images were taken.

    Parameters
    ----------
    images
        The images that the camera was calibrated from: folders, files or patterns such as 'left*.jpg', of images and
        clips, or corner files, as for `omnisight calibrate`.
    camera
        The resulting calibration, a file of any format.
    pattern
        Inner corners of the board, columns x rows. By default the board of the camera file, or the one detected.
    square
        Side of a square with its unit: 32.5mm.
    target
        Board file, instead of --pattern and --square.
    name
        Camera to use from a file with several cameras, such as a rig.
    image_size
        Width and height of the images of a corner file, such as 1280x800, if the file does not contain them.
    which
        Camera to use from a corner file with several cameras.
    count
        Number of images to propose, 1 to 20.
    draw
        Image file to write: the proposed boards and the uncertainty, over one of the images or an empty frame.
    apply_exif
        Rotate images by their EXIF orientation.
    cache
        Reuse detected boards of unchanged images.
    json
        Print one JSON object and nothing else.
    quiet
        Show no progress.
    """
    from omnisight.cli._next_report import print_json, print_report
    from omnisight.images.output_paths import refuse_overwrite
    from omnisight.pipeline.detect import is_corner_source, source_paths
    from omnisight.pipeline.next_view import NextViewOptions, next_view

    options = NextViewOptions(
        pattern=pattern,
        square=square,
        target=target,
        apply_exif=apply_exif,
        cache=cache,
        image_size=image_size,
        which=which,
        count=count,
        name=name,
    )
    if draw is not None:
        paths = source_paths(images)
        refuse_overwrite([draw], paths)
        _check_drawing_file(draw, [] if is_corner_source(images) else paths)
    with progress(quiet or json) as report:
        proposal = next_view(images, camera, options, progress=report)
    detections = proposal.detections
    assert detections is not None
    if draw is not None:  # a corner file may name images
        refuse_overwrite([draw], [image.path for image in detections.images])
    if json:
        print_json(proposal, detections)
    else:
        print_report(proposal, detections)
    if draw is not None:
        from omnisight.report.drawings.next_view import draw_proposal

        draw_proposal(proposal, detections, draw, apply_exif=apply_exif)
        if not json:
            print(f"drawn     {draw}")


def _check_drawing_file(draw: Path, images: Sequence[Path]) -> None:
    """Raise `ValueError` if the drawing cannot be written, or would be read as an image of the set later."""
    if draw.is_dir():
        raise ValueError(f"{draw}: is a folder; name an image in it, such as {draw / 'next.png'}")
    if not draw.parent.is_dir():
        raise ValueError(f"{draw}: there is no folder {draw.parent}; create it first")
    if draw.parent.resolve() in {path.parent.resolve() for path in images}:
        raise ValueError(f"{draw}: its folder holds the images, so the drawing would be read as one; use another")
    if draw.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise ValueError(f"{draw}: a drawing is a .png or .jpg, not {draw.suffix or 'without an extension'}")
