"""Report of `omnisight target`."""

import re
import shlex

from omnisight.cli._output import elapsed, write_json
from omnisight.targets.boards import Board
from omnisight.targets.make_target import TargetFiles, asymmetric_alternative
from omnisight.targets.printing.paper import millimetres


def print_report(board: Board, files: TargetFiles) -> None:
    """Print the board, its paper, how to print it, and the files."""
    left, top, right, bottom = board.extent
    # The sentence may take several lines of the page.
    ruler = re.search(r"Print (at 100 %.*? mm\.)", " ".join(text.content for text in files.page.texts))
    assert ruler is not None
    print(f"board    {board.kind} {board}, {board.size} points, {millimetres(right - left, bottom - top)}")
    print(f"paper    {files.paper}, {millimetres(files.page.width, files.page.height)}")
    print(f"print    {ruler[1]} Measure the board as well, and glue it to something flat")
    if board.is_symmetric:
        corners = ", and its corners after every quarter turn" if board.columns == board.rows else ""
        print(
            f"note     {board.kind} {board} looks the same upside-down{corners}: it calibrates one camera, but two"
            f" cameras cannot agree which way up it is. {asymmetric_alternative(board) or 'A ChArUco board'} is"
            " unambiguous"
        )
    print(f"next     omnisight calibrate images/ --target {shlex.quote(str(files.json))}")
    print(f"written  {files.pdf}, {files.svg.name}, {files.json.name}")


def print_json(board: Board, files: TargetFiles) -> None:
    """Print the files and the board as one JSON object; lengths are in metres."""
    left, top, right, bottom = board.extent
    data = {
        "files": [str(file) for file in (files.pdf, files.svg, files.json)],
        "format": "pdf",
        "board": board.to_dict(),
        "points": board.size,
        "size_m": [right - left, bottom - top],
        "paper": files.paper,
        "paper_size_m": [files.page.width, files.page.height],
        "symmetric": board.is_symmetric,
        "seconds": round(elapsed(), 3),
    }
    write_json(data)
