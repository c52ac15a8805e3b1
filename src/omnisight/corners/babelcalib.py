"""BabelCalib's .mat: `corners`, `boards` and `imgsize` (Lochman et al., ICCV 2021; README of the repository, types).

Of every image `x` (2 x N, px from ONE) and `cspond` (2 x N): the number of a point on its board and that of the
board, both from one. Of every board `X` (2 x K, on it) and `Rt` (3 x 4), target_from_board: several boards are one
rigid body. `imgsize` is height, width.
"""

from typing import Any

import numpy as np

from omnisight.corners._matlab import FIRST, array_of, is_mat, structs_of
from omnisight.corners._protocol import Array, Corners, Seen, Told
from omnisight.formats._checks import picture_size
from omnisight.formats._matlab_file import read_mat

TITLE = "BabelCalib .mat"
SUFFIX = ".mat"
CONVENTION = "px, points and boards counted from ONE; size as height, width; Rt maps a board into the target"


def matches(text: str) -> bool:
    """Say whether this is a .mat with corners and boards."""
    return is_mat(text, "corners", "boards")


def parse(text: str, told: Told) -> Corners:
    """Read the images."""
    held = read_mat(text.encode("latin-1"))
    boards = [_board(k, fields) for k, fields in enumerate(structs_of(held["boards"], "boards"), 1)]
    size = (0, 0)
    if held.get("imgsize") is not None:
        if len(held["imgsize"]) != 2:
            raise ValueError(f"imgsize must be height and width, got {len(held['imgsize'])} numbers")
        size = picture_size(held["imgsize"][1], held["imgsize"][0])
    views = [_seen(k, fields, boards, size) for k, fields in enumerate(structs_of(held["corners"], "corners"), 1)]
    return Corners(views)


def _board(k: int, fields: dict[str, Any]) -> Array:
    """Give the points (K, 3) of a board in the frame of the target."""
    flat = array_of(fields.get("X"), f"boards({k}).X")
    if flat.ndim != 2 or flat.shape[0] not in (2, 3):
        raise ValueError(f"boards({k}).X must be 2 x K, got {' x '.join(map(str, flat.shape))}")
    points = np.zeros((flat.shape[1], 3))
    points[:, : len(flat)] = flat.T
    if fields.get("Rt") is None:
        return points
    pose = array_of(fields["Rt"], f"boards({k}).Rt")
    if pose.shape != (3, 4):
        raise ValueError(f"boards({k}).Rt must be 3 x 4, got {' x '.join(map(str, pose.shape))}")
    if np.abs(pose[:, :3] @ pose[:, :3].T - np.eye(3)).max() > 1e-3:
        raise ValueError(f"boards({k}).Rt begins with no rotation")
    return points @ pose[:, :3].T + pose[:, 3]


def _seen(k: int, fields: dict[str, Any], boards: list[Array], size: tuple[int, int]) -> Seen:
    seen, which = (array_of(fields.get(name), f"corners({k}).{name}") for name in ("x", "cspond"))
    if not seen.size:
        return Seen("", np.zeros((0, 3)), np.zeros((0, 2)), size=size)
    if seen.ndim != 2 or len(seen) not in (2, 3) or which.shape != (2, seen.shape[1]):
        raise ValueError(
            f"corners({k}): x must be 2 x N and cspond 2 x N, got {' x '.join(map(str, seen.shape))} and"
            f" {' x '.join(map(str, which.shape))}"
        )
    point, board = which - FIRST
    counts = np.array([len(points) for points in boards])
    right = (board == board.round()) & (point == point.round()) & (board >= 0) & (board < len(boards)) & (point >= 0)
    right[right] &= point[right] < counts[board[right].astype(int)]
    if not right.all():
        wrong = which[:, int(np.argmin(right))]
        raise ValueError(
            f"corners({k}).cspond says point {wrong[0]:g} of board {wrong[1]:g}; there are {len(boards)} boards with"
            f" {', '.join(map(str, counts[:8]))} points"
        )
    starts = np.concatenate([[0], np.cumsum(counts)])
    points = np.concatenate(boards)[starts[board.astype(int)] + point.astype(int)]
    return Seen("", points, seen[:2].T - FIRST, size=size)
