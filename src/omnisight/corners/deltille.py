"""Deltille's .orpc of an image, with the .dsc of its target beside it, and a .tp where that has several boards.

The .orpc has five lines `name: value` and then `board,point,ordered,x,y`, all from 0; its image's centre of the
top-left pixel is (0, 0). The .dsc has for each board `id,squares,squares,side in mm`, a line of the tags, and its
points `tag,i,j,x,y,z` in CENTIMETRES; the second number of squares is 0 for a triangle. The .tp has for each board its
id and 3 x 4 target_from_board, in millimetres (Deltille's detector; CalibrationTarget.m and loadORPC.m of BabelCalib).
"""

import re

import numpy as np

from omnisight.corners._protocol import Array, Corners, Seen, Told
from omnisight.formats._checks import picture_size

TITLE = "Deltille .orpc"
SUFFIX = ".orpc"
CONVENTION = (
    "board,point,ordered,x,y from 0; integer pixel = pixel centre; points in cm in the .dsc, boards in mm in the .tp"
)
HEAD = re.compile(
    r"filename:[ \t]*(.*)\r?\nwidth:[ \t]*(\d{1,7})\s+height:[ \t]*(\d{1,7})\s+num_corners:[ \t]*(\d{1,9})"
)
CENTIMETRE, MILLIMETRE = 1e-2, 1e-3
MOST = 1_000_000  # lines


def matches(text: str) -> bool:
    """Say whether it has the five lines."""
    return HEAD.match(text.lstrip()[:2000]) is not None


def parse(text: str, told: Told) -> Corners:
    """Read the image."""
    lines = text.strip().splitlines()
    head = HEAD.match(text.lstrip()[:2000])
    assert head is not None
    size = picture_size(int(head[2]), int(head[3]))
    table = _numbers(lines[5:], 5, "line", 6)
    if len(table) != int(head[4]):
        raise ValueError(f"num_corners is {head[4]}, but {len(table)} follow: is the file cut off?")
    if told.beside is None:
        raise ValueError("the points are in a .dsc beside it, and where this one lies is not known")
    boards = target_points(told.beside(".dsc"), told)
    points = np.empty((len(table), 3))
    for i, (board, point) in enumerate(table[:, :2].astype(int)):
        if board not in boards or not 0 <= point < len(boards[board]):
            raise ValueError(f"point {point} of board {board} is not in the .dsc: is that of another target?")
        points[i] = boards[board][point]
    return Corners([Seen(head[1].strip(), points, table[:, 3:5], size=size)], metres=True)


def target_points(text: str, told: Told) -> dict[int, Array]:
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
        assert told.beside is not None
        poses = _poses(told.beside(".tp"))
    found: dict[int, Array] = {}
    for name, lines in boards.items():
        points = CENTIMETRE * _numbers(lines, 6, ".dsc, point", 1)[:, 3:]
        if len(boards) > 1:
            if name not in poses:
                continue  # a board that was not placed; its corners, if there are any, are refused
            points = points @ poses[name][:, :3].T + MILLIMETRE * poses[name][:, 3]
        found[name] = points
    return found


def _poses(text: str) -> dict[int, Array]:
    """Read a .tp: after lines of comment, an id and twelve numbers per board."""
    words = [word for line in text.splitlines() if not line.lstrip().startswith("#") for word in line.split()]
    if not words or len(words) % 13:
        raise ValueError(f"the .tp must have 13 numbers per board, an id and 3 x 4, got {len(words)}")
    table = _numbers([",".join(words[i : i + 13]) for i in range(0, len(words), 13)], 13, ".tp, board", 1)
    for row in table:
        rotation = row[1:].reshape(3, 4)[:, :3]
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-3:
            raise ValueError(f"the .tp has no rotation for board {row[0]:g}")
    return {int(row[0]): row[1:].reshape(3, 4) for row in table}


def _numbers(lines: list[str], count: int, what: str, first: int) -> Array:
    """Read rows of numbers parted by commas."""
    if len(lines) > MOST:
        raise ValueError(f"{len(lines)} lines; corners have at most {MOST}")
    table = np.empty((len(lines), count))
    for i, line in enumerate(lines):
        words = line.split(",")
        try:
            table[i] = [float(word) for word in words]
        except ValueError:
            raise ValueError(f"{what} {i + first} must be {count} numbers, got {line[:60]!r}") from None
    return table
