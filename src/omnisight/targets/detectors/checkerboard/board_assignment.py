"""Assign a grid of corners to a board: which board it is, and which part of it."""

from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.boards.checkerboard import Checkerboard
from omnisight.targets.detection_limits import MIN_BOARD_SHARE
from omnisight.targets.detections import Detection
from omnisight.targets.detectors.checkerboard.corner_grid import CornerGrid

# The same for a grid that ends at the board's margin or the image's border on all sides.
MIN_BORDERED_SHARE = 0.15
# Part of a grid's corners that must be present to take its size for a board's.
MIN_FILLED_SHARE = 0.9


def assign_to_board(grid: CornerGrid, board: Checkerboard) -> Detection | None:
    """Assign the ids of a board's corners to a grid.

    The grid is rotated until it fits and its colours agree. Among the remaining positions, borders decide: where the
    grid ends at a margin, so does the board. Of two rotations of a symmetric board, the one that starts nearest the
    top left of the image is taken; in another image or camera that may be the other one.

    Returns
    -------
    Detection or None
        None if the grid does not fit on the board, or is too small a part of it to be certain. Its `located` is False
        if several positions remain.
    """
    min_share = MIN_BOARD_SHARE if "open" in grid.borders else MIN_BORDERED_SHARE
    if len(grid) < min_share * board.size:
        return None
    cells = np.arange(grid.present.size).reshape(grid.shape)
    positions = [
        (score, rotated, row, column, np.rot90(cells, quarters))
        for quarters in range(4)
        for rotated in [grid.rotated(quarters)]
        for score, row, column in _positions(rotated, board)
    ]
    if not positions:
        return None
    best = max(score for score, *_ in positions)
    detections: list[Detection] = []
    distinct: set[tuple[int, ...]] = set()
    for score, rotated, row, column, order in positions:
        if score == best:
            detection = _detection(rotated, row, column, board)
            detections.append(detection)
            distinct.add(_canonical_ids(detection.ids[np.argsort(order[rotated.present])], board))
    first = min(detections, key=lambda d: float(d.pixels[0].sum()))
    return Detection(first.ids, first.pixels, first.covariance, located=len(distinct) == 1, board=board)


def most_common_pattern(images: Sequence[Sequence[CornerGrid]]) -> tuple[int, int] | None:
    """Return the (columns, rows), columns >= rows, of the board that most images show; None if none shows any.

    Grids that end at a margin all around count three times; if no grid is complete, the largest grid is taken.
    """
    votes: Counter[tuple[int, int]] = Counter()
    for grids in images:
        filled = [grid for grid in grids if len(grid) >= MIN_FILLED_SHARE * grid.present.size]
        for pattern in {grid.pattern for grid in filled}:
            votes[pattern] += 1
        for pattern in {grid.pattern for grid in filled if set(grid.borders) == {"margin"}}:
            votes[pattern] += 2
    if not votes:
        return max((grid.pattern for grids in images for grid in grids), default=None)
    return max(votes, key=lambda pattern: (votes[pattern], pattern[0] * pattern[1]))


def _positions(grid: CornerGrid, board: Checkerboard) -> Iterable[tuple[int, int, int]]:
    """Yield the positions (score, first row, first column) where a grid fits on a board by its colours."""
    rows, columns = grid.shape
    top, bottom, left, right = (border == "margin" for border in grid.borders)
    if (top and bottom and rows < board.rows) or (left and right and columns < board.columns):
        return  # all of a smaller board
    # A symmetric board may be printed with a dark or a bright first square; where a quarter turn exchanges them, a dark
    # one can always come first.
    coloured = not board.is_symmetric or (board.columns == board.rows and board.columns % 2 == 1)
    for row in range(board.rows - rows + 1):
        for column in range(board.columns - columns + 1):
            if not coloured or grid.starts_dark == ((row + column) % 2 == 0):
                at_margins = (
                    (top and row == 0)
                    + (bottom and row + rows == board.rows)
                    + (left and column == 0)
                    + (right and column + columns == board.columns)
                )
                yield at_margins, row, column


def _detection(grid: CornerGrid, row: int, column: int, board: Checkerboard) -> Detection:
    i, j = np.nonzero(grid.present)
    return Detection((i + row) * board.columns + j + column, grid.pixels[i, j], grid.covariance[i, j])


def _canonical_ids(ids: NDArray[np.int64], board: Checkerboard) -> tuple[int, ...]:
    """Return the least of a grid's ids under the rotations of the board onto itself: equal if they look equal."""
    rotations = [ids]
    if board.is_symmetric:
        rotations.append(board.size - 1 - ids)
        if board.columns == board.rows and board.columns % 2 == 0:  # a quarter turn keeps the colours
            i, j = np.divmod(ids, board.columns)
            quarter = j * board.columns + board.columns - 1 - i
            rotations += [quarter, board.size - 1 - quarter]
    return min(tuple(ids.tolist()) for ids in rotations)
