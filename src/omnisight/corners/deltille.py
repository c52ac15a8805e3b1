"""Deltille's .orpc of an image, with the .dsc of its target beside it, and a .tp if that has several boards.

The .orpc has five lines `name: value` and then `board,point,ordered,x,y`, all from 0; the centre of the top-left pixel
is (0, 0). The .dsc has for each board `id,squares,squares,side in mm`, a line of the tags, and its points
`tag,i,j,x,y,z` in CENTIMETRES; the second number of squares is 0 for a triangle. The .tp has for each board its id and
3 x 4 target_from_board, in millimetres (Deltille's detector; CalibrationTarget.m and loadORPC.m of BabelCalib).
"""

import re

import numpy as np

from omnisight.corners._poses import check_rotation
from omnisight.corners._protocol import Array, CornerFile, ImageCorners, ReadOptions
from omnisight.formats._limits import HEAD_CHARS, MAX_ENTRIES
from omnisight.formats._values import image_size

TITLE = "Deltille .orpc"
SUFFIX = ".orpc"
CONVENTION = (
    "board,point,ordered,x,y from 0; integer pixel = pixel centre; points in cm in the .dsc, boards in mm in the .tp"
)
HEADER = re.compile(
    r"filename:[ \t]*(.*)\r?\nwidth:[ \t]*(\d{1,7})\s+height:[ \t]*(\d{1,7})\s+num_corners:[ \t]*(\d{1,9})"
)
CENTIMETRE, MILLIMETRE = 1e-2, 1e-3  # m
HEADER_LINES = 5


def matches(text: str) -> bool:
    """Return whether it begins with the header."""
    return HEADER.match(text.lstrip()[:HEAD_CHARS]) is not None


def parse(text: str, options: ReadOptions) -> CornerFile:
    """Read the image."""
    lines = text.strip().splitlines()
    head = HEADER.match(text.lstrip()[:HEAD_CHARS])
    assert head is not None
    size = image_size(int(head[2]), int(head[3]))
    table = _numbers(lines[HEADER_LINES:], 5, "line", HEADER_LINES + 1)
    if len(table) != int(head[4]):
        raise ValueError(f"num_corners is {head[4]}, but {len(table)} follow: is the file cut off?")
    if options.read_sibling is None:
        raise ValueError("the points are in a .dsc in the folder of the file, which is not known")
    boards = target_points(options.read_sibling(".dsc"), options)
    points = np.empty((len(table), 3))
    for i, (board, point) in enumerate(table[:, :2].astype(int)):
        if board not in boards or not 0 <= point < len(boards[board]):
            raise ValueError(f"point {point} of board {board} is not in the .dsc: does it belong to another target?")
        points[i] = boards[board][point]
    return CornerFile([ImageCorners(head[1].strip(), points, table[:, 3:5], size=size)], in_metres=True)


def target_points(text: str, options: ReadOptions) -> dict[int, Array]:
    """Read a .dsc: the points (K, 3) of each board by its id, in metres in the frame of the target."""
    boards: dict[int, list[str]] = {}
    current: list[str] = []
    for line in text.strip().splitlines():
        count = line.count(",") + 1
        if count == 4:
            current = boards.setdefault(int(_numbers([line], 4, ".dsc, line of a board", 1)[0, 0]), [])
        elif count == 6:
            current.append(line)
    if not boards or not all(boards.values()):
        raise ValueError("the .dsc has no board with points")
    poses: dict[int, Array] = {}
    if len(boards) > 1:
        assert options.read_sibling is not None
        poses = _poses(options.read_sibling(".tp"))
    placed: dict[int, Array] = {}
    for name, lines in boards.items():
        points = CENTIMETRE * _numbers(lines, 6, ".dsc, point", 1)[:, 3:]
        if len(boards) > 1:
            if name not in poses:
                continue  # corners of a board without a pose are refused
            points = points @ poses[name][:, :3].T + MILLIMETRE * poses[name][:, 3]
        placed[name] = points
    return placed


def _poses(text: str) -> dict[int, Array]:
    """Read a .tp: after comments, an id and twelve numbers per board."""
    words = [word for line in text.splitlines() if not line.lstrip().startswith("#") for word in line.split()]
    if not words or len(words) % 13:
        raise ValueError(f"the .tp must have 13 numbers per board, an id and 3 x 4, got {len(words)}")
    table = _numbers([",".join(words[i : i + 13]) for i in range(0, len(words), 13)], 13, ".tp, board", 1)
    for row in table:
        check_rotation(row[1:].reshape(3, 4)[:, :3], f"the .tp, board {row[0]:g},")
    return {int(row[0]): row[1:].reshape(3, 4) for row in table}


def _numbers(lines: list[str], count: int, what: str, first: int) -> Array:
    """Return rows of comma-separated numbers; `first` is the number of the first row in messages."""
    if len(lines) > MAX_ENTRIES:
        raise ValueError(f"{len(lines)} lines; at most {MAX_ENTRIES} are read")
    table = np.empty((len(lines), count))
    for i, line in enumerate(lines):
        words = line.split(",")
        try:
            table[i] = [float(word) for word in words]
        except ValueError:
            raise ValueError(f"{what} {i + first} must be {count} numbers, got {line[:60]!r}") from None
    return table
