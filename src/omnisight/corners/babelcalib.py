"""BabelCalib's .mat: `corners`, `boards` and `imgsize` (Lochman et al., ICCV 2021; README of the repository, types).

Each image has `x` (2 x N, px from ONE) and `cspond` (2 x N): the number of a point on its board and that of the board,
both from one. Each board has `X` (2 x K, on the board) and `Rt` (3 x 4), target_from_board: several boards are one
rigid body. `imgsize` is height, width.
"""

from typing import Any

import numpy as np

from omnisight.corners._matlab import has_variables, matrix_of, read_variables, size_from_rows_columns, structs_of
from omnisight.corners._poses import check_rotation
from omnisight.corners._protocol import Array, CornerFile, ImageCorners, ReadOptions
from omnisight.formats._values import FIRST_PIXEL

TITLE = "BabelCalib .mat"
SUFFIX = ".mat"
CONVENTION = "px, points and boards counted from ONE; size as height, width; Rt is target_from_board"


def matches(text: str) -> bool:
    """Return whether this is a .mat with corners and boards."""
    return has_variables(text, "corners", "boards")


def parse(text: str, options: ReadOptions) -> CornerFile:
    """Read the images."""
    variables = read_variables(text)
    boards = [_board(k, fields) for k, fields in enumerate(structs_of(variables["boards"], "boards"), 1)]
    size = size_from_rows_columns(variables.get("imgsize"), "imgsize")
    corners = structs_of(variables["corners"], "corners")
    return CornerFile([_image(k, fields, boards, size) for k, fields in enumerate(corners, 1)])


def _board(k: int, fields: dict[str, Any]) -> Array:
    """Return the points (K, 3) of a board in the frame of the target."""
    flat = matrix_of(fields.get("X"), f"boards({k}).X")
    if flat.ndim != 2 or flat.shape[0] not in (2, 3):
        raise ValueError(f"boards({k}).X must be 2 x K, got {_shape(flat)}")
    points = np.zeros((flat.shape[1], 3))
    points[:, : len(flat)] = flat.T
    if fields.get("Rt") is None:
        return points
    pose = matrix_of(fields["Rt"], f"boards({k}).Rt")
    if pose.shape != (3, 4):
        raise ValueError(f"boards({k}).Rt must be 3 x 4, got {_shape(pose)}")
    check_rotation(pose[:, :3], f"boards({k}).Rt")
    return points @ pose[:, :3].T + pose[:, 3]


def _image(k: int, fields: dict[str, Any], boards: list[Array], size: tuple[int, int]) -> ImageCorners:
    """Return the corners of an image."""
    pixels, numbers = (matrix_of(fields.get(name), f"corners({k}).{name}") for name in ("x", "cspond"))
    if not pixels.size:
        return ImageCorners.empty(size=size)
    if pixels.ndim != 2 or len(pixels) not in (2, 3) or numbers.shape != (2, pixels.shape[1]):
        raise ValueError(f"corners({k}): x must be 2 x N and cspond 2 x N, got {_shape(pixels)} and {_shape(numbers)}")
    point, board = numbers - 1
    counts = np.array([len(points) for points in boards])
    valid = (board == board.round()) & (point == point.round()) & (board >= 0) & (board < len(boards)) & (point >= 0)
    valid[valid] &= point[valid] < counts[board[valid].astype(int)]
    if not valid.all():
        wrong = numbers[:, int(np.argmin(valid))]
        raise ValueError(
            f"corners({k}).cspond refers to point {wrong[0]:g} of board {wrong[1]:g}; there are {len(boards)} boards"
            f" with {', '.join(map(str, counts[:8]))} points"
        )
    starts = np.concatenate([[0], np.cumsum(counts)])
    points = np.concatenate(boards)[starts[board.astype(int)] + point.astype(int)]
    return ImageCorners("", points, pixels[:2].T - FIRST_PIXEL, size=size)


def _shape(matrix: Array) -> str:
    return " x ".join(map(str, matrix.shape))
