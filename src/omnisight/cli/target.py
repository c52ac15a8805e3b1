"""omnisight target."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from omnisight.cli._output import is_json

GROUP = "Calibration"


@dataclass(frozen=True, kw_only=True)
class BoardFields:
    """Fields of boards; each kind has some of them, and None is its default.

    Attributes
    ----------
    squares
        checkerboard, charuco: squares, columns x rows, in place of the pattern: 10x7.
    square
        Side of a square with its unit: 30mm.
    marker
        charuco: side of a marker; three quarters of the square by default. aruco_grid: side of a marker.
    separation
        aruco_grid: gap between markers with its unit; a quarter of the marker by default.
    dictionary
        charuco, aruco_grid: OpenCV's name of the markers' dictionary, such as 4x4_50; DICT_5X5_100 and DICT_6X6_250
        by default.
    first_marker
        charuco, aprilgrid, aruco_grid: number of the first marker in the dictionary; 0 by default. Boards that are in
        view at the same time need different markers.
    legacy
        charuco: the layout of OpenCV before 4.6.
    tag
        aprilgrid: side of a tag with its black border.
    spacing
        aprilgrid: gap between tags over a tag's side, 0.3 by default. circles: distance of a row from
        the next with its unit, such as 18mm; symmetric_circles: distance of neighbouring circles.
    diameter
        Diameter of a circle; by default the spacing for circles, and 0.4 of it for symmetric_circles, as in OpenCV.
    """

    squares: str | None = None
    square: str | None = None
    marker: str | None = None
    separation: str | None = None
    dictionary: str | None = None
    first_marker: int | None = None
    legacy: bool = False
    tag: str | None = None
    spacing: str | None = None
    diameter: str | None = None


def target(
    kind: str,
    pattern: str | None = None,
    /,
    *,
    fields: Annotated[BoardFields, Parameter(name="*")] = BoardFields(),
    paper: str | None = None,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
) -> None:
    """Make a board to print at true scale: a PDF, an SVG, and the JSON file that describes it.

    Specify the kind of the board, its pattern and its size:

        omnisight target checkerboard 9x6 --square 24mm
        omnisight target charuco 9x6 --square 30mm --paper A3 -o board.pdf
        omnisight target aprilgrid 6x6 --tag 24mm
        omnisight target circles 4x11 --spacing 18mm

    Parameters
    ----------
    kind
        checkerboard, charuco, aprilgrid, aruco_grid (OpenCV's GridBoard), circles (staggered rows) or
        symmetric_circles.
    pattern
        Columns x rows: inner corners of a checkerboard or charuco (10x7 squares have 9x6), tags, markers, circles.
    paper
        A0 to A5, Letter, Legal, Tabloid, or a size such as 600x400mm; A4 by default, or Letter where it is in use (by
        LC_PAPER or LANG).
    output
        The PDF to write; SVG and JSON are written next to it. By default it is named after the board and its size.
        Only drawings of omnisight's and the JSON of the same board are overwritten.
    """
    from omnisight.cli._target_report import print_json, print_report
    from omnisight.targets.make_target import new_board, write_target

    values = vars(fields) | {"legacy": fields.legacy or None}
    board = new_board(kind, pattern, {name: value for name, value in values.items() if value is not None})
    files = write_target(board, output, paper)
    (print_json if is_json() else print_report)(board, files)
