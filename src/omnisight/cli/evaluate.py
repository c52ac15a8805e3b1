"""omnisight evaluate."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from omnisight.cli._progress import progress

if TYPE_CHECKING:
    from omnisight.camera import Camera
    from omnisight.ray_camera import RayCamera
    from omnisight.targets import Detections


def evaluate(
    camera: Path,
    pictures: list[str],
    /,
    *,
    pattern: Annotated[str | None, Parameter(alias="--size")] = None,
    square: str | None = None,
    target: Path | None = None,
    name: str | None = None,
    compare: list[Path] | None = None,
    image_size: str | None = None,
    which: str | None = None,
    threshold: float = 1.5,
    flat: bool = False,
    draw: Path | None = None,
    apply_exif: bool = False,
    cache: bool = True,
    json: bool = False,
    quiet: bool = False,
) -> None:
    """Judge a calibrated camera on other images of a board, or on other corners.

    The camera stays as it is; only where every board stands is found, and how it is bent. Corners are taken as they are
    found at first, or given: none is looked for with the camera's help.

    Parameters
    ----------
    camera
        A calibration file of any format.
    images
        Folders, files or patterns of images and clips that it was not calibrated on, or files of corners, as
        `omnisight calibrate` takes them.
    pattern
        Inner corners of the board, columns x rows.
    square
        Side of a square with its unit: 32.5mm.
    target
        The board as a file, in place of --pattern and --square.
    name
        Which camera, where the camera's file holds several.
    compare
        Another camera's file, judged on the same corners; may be given several times.
    image_size
        Width and height of the images that corners are from, such as 1280x800, where their file does not say.
    which
        Which camera, where a file of corners holds several: its name there.
    threshold
        Length of a residual, px, past which it counts less, in the poses and in wRMS.
    flat
        Take the board as flat. Otherwise its bend is found with the poses, the same in all images.
    draw
        A folder for the images with their corners and residuals drawn in.
    apply_exif
        Turn images as their EXIF orientation says.
    cache
        Remember found boards, by the content of the images.
    json
        Print one JSON object and nothing else.
    quiet
        Show no progress.
    """
    from omnisight.calibration.evaluation import evaluate_camera
    from omnisight.cli._board import asked_board
    from omnisight.cli._detect_report import advice
    from omnisight.cli._evaluate_report import as_json, print_report
    from omnisight.cli._given import Given
    from omnisight.formats import load
    from omnisight.images.output_paths import drawing_paths, image_labels
    from omnisight.targets.observations import Observations

    (first, path), *others = _labelled([camera, *(compare or [])]).items()
    cameras = {first: load(path, name=name), **{label: load(other) for label, other in others}}
    board = asked_board(pattern, square, target)
    given = Given.of(pictures, board, square=square, image_size=image_size, which=which)
    if draw is not None:
        drawing_paths(given.paths, draw)
    with progress(quiet or json) as tell:
        search = given.search(tell, apply_exif=apply_exif, cache=cache)
        names = image_labels([picture.path for picture in search.images])
        if not search.found:
            why = advice(search.board) if search.board is not None else "give --pattern, such as 9x6, or --target"
            raise ValueError(f"no board in {len(search.images)} images: {search.hint or why}")
        views = Observations.of_search(search, names)
        found = {}
        for i, (label, one) in enumerate(cameras.items()):
            tell("judge", i, len(cameras))
            _must_fit(one, label, search)
            found[label] = evaluate_camera(one, views, threshold=threshold, flat=flat)
        tell("judge", len(cameras), len(cameras))
    if json:
        as_json(search, names, found)
    else:
        print_report(search, names, found)
    if draw is not None:
        from omnisight.report.drawings.residuals import draw_residuals

        judged = next(iter(found.values()))
        num_blank = draw_residuals(search, judged.residuals, judged.outliers, draw, apply_exif=apply_exif)
        if not json:
            note = f" ({num_blank} without image, since the files are missing)" if num_blank else ""
            print(f"drawn: {draw}{note}")


def _labelled(files: list[Path]) -> dict[str, Path]:
    """Name the cameras to a reader; one that is given twice is judged once."""
    from omnisight.images.output_paths import image_labels

    once = list({path.resolve(): path for path in files}.values())
    return dict(zip(image_labels(once), once, strict=True))


def _must_fit(camera: "Camera | RayCamera", label: str, search: "Detections") -> None:
    """Refuse a camera of other images, or one of rays in another unit than the board."""
    from omnisight.ray_camera import RayCamera

    if all(camera.size) and camera.size != search.size:
        raise ValueError(
            f"{label}: for images of {camera.width}x{camera.height}; these are {search.size[0]}x{search.size[1]}:"
            " give images as the camera took them"
        )
    unit = "squares" if search.board is None else search.board.unit
    if isinstance(camera, RayCamera) and camera.unit != unit:
        raise ValueError(
            f"{label}: a camera of rays whose lengths are in {camera.unit}, the board's are in {unit}: "
            + ("give --square, such as --square 30mm" if camera.unit == "m" else "leave out --square")
        )
