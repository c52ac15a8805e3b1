"""The board that `omnisight next` holds up where corners were given: their file says its points, not what it is."""

from dataclasses import replace

import numpy as np

from omnisight.targets import Board, Checkerboard, Detections, PointTarget
from omnisight.targets.boards.checkerboard import MIN_CORNERS


def held_board(search: Detections, told: Board | None, *, asked: bool) -> tuple[Detections, Board]:
    """Give the board to hold up, and the search with the points in that board's frame.

    Corners of a plane tell how that plane is bent: what is held up is bent alike, and so lies where they do. It is the
    board that was told, or a checkerboard as large, with as many corners. Of a solid body only the camera follows, and
    any flat board may be held. A board of another unit than the corners is as good as none; `asked` for, it is refused.

    Raises
    ------
    ValueError
        If the points are those of a solid body, and no board was told; or the board that was asked for has another
        unit.
    """
    found = search.board
    if not isinstance(found, PointTarget):
        assert found is not None
        return search, found
    if found.points[:, 2].any():
        if told is None:
            raise ValueError(
                f"which board to hold up is not known, for the corners are of {found}: give --pattern, such as 9x6, or"
                " --target, a flat board for the next image"
            )
        return search, told
    if told is not None and told.unit != found.unit:
        if asked:
            raise ValueError(
                f"the corners are in {found.unit}, and what {told} is in {found.unit} is not known: give --pattern,"
                " such as 9x6, instead"
            )
        told = None
    board = told or _as_large(found)
    moved = found.points - (found.points.min(0) - board.points.min(0))
    return replace(search, board=PointTarget(moved, found.unit)), board


def _as_large(target: PointTarget) -> Checkerboard:
    """Give the checkerboard whose inner corners the points are, or else one as large with about as many."""
    from scipy.spatial import KDTree

    nearest, _ = KDTree(target.points).query(target.points, k=2)
    sides = np.ptp(target.points[:, :2], axis=0)
    step = max(float(np.median(nearest[:, 1])), float(np.sqrt(sides.prod() / len(target.points))))
    columns, rows = (max(MIN_CORNERS, round(side / step) + 1) for side in sides.tolist())
    return Checkerboard(columns, rows, square=step if target.unit == "m" else None)
