"""omnisight detect."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._progress import progress

FOLDER = Path("omnisight-detect")


def detect(
    pictures: list[str],
    /,
    *,
    pattern: Annotated[str | None, Parameter(alias="--size")] = None,
    square: str | None = None,
    target: Path | None = None,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    apply_exif: bool = False,
    cache: bool = True,
    json: bool = False,
    quiet: bool = False,
) -> None:
    """Find the board in images and show what was found, without calibrating.

    Writes each image with the corners drawn in: their order, an ellipse for how sure each one is (magnified), and the
    border of what the lens shows.

    Parameters
    ----------
    images
        Folders, files or patterns such as 'left*.jpg', of images and videos. Of a clip the frames that say most are
        taken.
    pattern
        Inner corners of the board, columns x rows: a board of 9x7 squares has 8x6. What most images agree on if
        absent.
    square
        Side of a square with its unit: 32.5mm.
    target
        The board as a file, in place of --pattern and --square: what `omnisight target make` wrote, or a target of
        Kalibr's (YAML).
    output
        A folder for the drawn images: omnisight-detect unless told otherwise; with --json none are drawn unless told.
    apply_exif
        Turn images as their EXIF orientation says.
    cache
        Remember found boards, by the content of the images.
    json
        Print one JSON object and nothing else.
    quiet
        Show no progress.
    """
    from omnisight.cli._board import asked_board, search_boards
    from omnisight.cli._detect_report import as_json, print_report
    from omnisight.images import collect_images
    from omnisight.images.output_paths import drawing_paths
    from omnisight.report.drawings.detections import draw_detections

    board = asked_board(pattern, square, target)
    paths = collect_images(pictures, videos=True)
    folder = output if output is not None or json else FOLDER
    if folder is not None:
        drawing_paths(paths, folder)
    with progress(quiet or json) as report:
        search = search_boards(paths, board, square, report, apply_exif=apply_exif, cache=cache)
        if all(picture.size is None for picture in search.images):
            raise ValueError(
                "\n".join(["none of the images can be read:", *(f"  {p.note}" for p in search.images[:5])])
            )
        if json:
            as_json(search)
        else:
            print_report(search)
        if folder is not None:
            files = drawing_paths([picture.path for picture in search.images], folder)
            draw_detections(search, files, apply_exif=apply_exif, progress=lambda done, all_: report("draw", done, all_))
    if folder is not None and not json:
        print(f"drawn: {folder}")
