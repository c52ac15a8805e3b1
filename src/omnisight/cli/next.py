"""omnisight next."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from omnisight.cli._progress import progress

if TYPE_CHECKING:
    from omnisight.cli._given import Given

MOST = 20


def next(
    pictures: list[str],
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
    """Say where to hold the board for the next image: where it makes the camera surest.

    Hundreds of places, distances and tilts are tried on paper; the one that lowers the worst uncertainty most is the
    next image, and with it taken as done the ones after it.

    Parameters
    ----------
    images
        What the camera was calibrated from: folders, files or patterns such as 'left*.jpg', of images and clips, or
        files of corners, as `omnisight calibrate` takes them.
    camera
        The calibration that came of them: a file of any format.
    pattern
        Inner corners of the board, columns x rows. That of the camera's file if absent, or else looked for.
    square
        Side of a square with its unit: 32.5mm.
    target
        The board as a file, in place of --pattern and --square.
    name
        Which camera, where the file holds several, as that of a rig does.
    image_size
        Width and height of the images that corners are from, such as 1280x800, where their file does not say.
    which
        Which camera, where a file of corners holds several: its name there.
    count
        How many images to propose, one after another.
    draw
        An image of where to hold the board: over one of yours, or over an empty frame where there are corners alone,
        with what is known and what is not.
    apply_exif
        Turn images as their EXIF orientation says.
    cache
        Remember found boards, by the content of the images.
    json
        Print one JSON object and nothing else.
    quiet
        Show no progress.
    """
    import dataclasses

    from omnisight.cli._board import asked_board
    from omnisight.cli._central import central_camera
    from omnisight.cli._given import Given
    from omnisight.cli._next_board import held_board
    from omnisight.cli._next_report import as_json, print_report
    from omnisight.images.output_paths import image_labels, refuse_overwrite
    from omnisight.next_view.information_prior import InformationPrior
    from omnisight.next_view.proposal import propose
    from omnisight.targets.observations import Observations

    if not 1 <= count <= MOST:
        raise ValueError(f"--count is {count}: give 1 to {MOST} images to propose")
    source = central_camera(camera, name=name, takes=False)
    asked = asked_board(pattern, square, target)
    board = _board_of(source, camera) if asked is None and square is None else asked
    given = Given.of(pictures, board, square=square, image_size=image_size, which=which)
    if draw is not None:
        _must_be_apart(draw, given)
    with progress(quiet or json) as report:
        search = given.search(report, apply_exif=apply_exif, cache=cache)
        if not search.found:
            raise ValueError(_none_found(search))
        if draw is not None:  # images may lie beside the corners
            refuse_overwrite([draw], [picture.path for picture in search.images])
        if min(source.size) < 1:  # its file does not say: the images do
            source = dataclasses.replace(source, size=search.size)
        if source.size != search.size:
            raise ValueError(
                f"{camera}: the images are {search.size[0]}x{search.size[1]}, the camera"
                f" {source.width}x{source.height}: give the images that it was calibrated from, or calibrate these"
            )
        search, held = held_board(search, board, asked=asked is not None)
        report("propose", 0, 1)
        known = InformationPrior.of(source, Observations.of_search(search, image_labels([p.path for p in search.images])))
        proposal = propose(known, held, search.field, count)
        report("propose", 1, 1)
    if json:
        as_json(proposal, search, held)
    else:
        print_report(proposal, search, held)
    if draw is not None:
        from omnisight.report.drawings.next_view import draw_proposal

        draw_proposal(proposal, search, held, draw, apply_exif=apply_exif)
        if not json:
            print(f"\ndrawn: {draw}")


def _board_of(source: Any, file: Path) -> Any:
    """Give the board that the camera was calibrated with, or None where its file does not say."""
    from omnisight.targets import PointTarget
    from omnisight.targets.boards import board_class

    values = source.provenance.get("target")
    if not isinstance(values, dict) or values.get("target") == PointTarget.kind:
        return None
    try:
        return board_class(str(values.get("target"))[:40]).from_dict(values)
    except ValueError as error:
        raise ValueError(f"{file}: provenance, target: {error}; give --pattern or --target") from None


def _must_be_apart(draw: Path, given: "Given") -> None:
    """Refuse, before any work, a drawing that would be lost, or be taken for an image of the set."""
    from omnisight.images.output_paths import refuse_overwrite

    refuse_overwrite([draw], given.paths)
    if draw.is_dir():
        raise ValueError(f"{draw}: is a folder; name an image in it, such as {draw / 'next.png'}")
    if not draw.parent.is_dir():
        raise ValueError(f"{draw}: there is no folder {draw.parent}; make it first")
    if not given.corners and draw.parent.resolve() in {path.parent.resolve() for path in given.paths}:
        raise ValueError(f"{draw}: its folder holds the images; what is drawn would be taken for one the next time")
    if draw.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise ValueError(f"{draw}: a drawing is a .png or .jpg, not {draw.suffix or 'without an extension'}")


def _none_found(search: Any) -> str:
    from omnisight.cli._detect_report import advice
    from omnisight.targets import PointTarget

    notes = [f"  {picture.path.name}: {picture.note}" for picture in search.images if picture.note][:5]
    if isinstance(search.board, PointTarget):
        said = f"none of {len(search.images)} images has corners enough"
    elif search.board is None:
        said = f"no checkerboard found in {len(search.images)} images: give --pattern, such as 9x6, or --target"
    else:
        said = f"the {search.board} board was found in none of {len(search.images)} images: "
        said += search.hint or advice(search.board)
    return "\n".join([said, *notes])
