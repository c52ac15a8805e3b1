"""Names and boards that corner files of several programs share."""

import re
from collections.abc import Sequence

from omnisight.corners._protocol import Array, ReadOptions
from omnisight.targets import Checkerboard

MIN_BOARD_SIDE, MAX_BOARD_SIDE = 3, 1000  # inner corners


def normalized(key: str) -> str:
    """Return a name in lower case without separators, which programs write differently."""
    return re.sub(r"[^a-z0-9]", "", key.lower())


def board_points(options: ReadOptions, sides: Sequence[object] | None, missing: str) -> Array:
    """Return the points (N, 3) of the user's board, or of a checkerboard of these inner corners."""
    if options.board is not None:
        return options.board.points
    if sides is None:
        raise ValueError(f"{missing}: specify --pattern, such as 9x6")
    columns, rows = sides
    if not (isinstance(columns, int) and isinstance(rows, int)) or not (
        min(columns, rows) >= MIN_BOARD_SIDE and max(columns, rows) <= MAX_BOARD_SIDE
    ):
        raise ValueError(
            f"pattern is {columns}x{rows}: expected {MIN_BOARD_SIDE} to {MAX_BOARD_SIDE} inner corners per side"
        )
    return Checkerboard(columns, rows).points
