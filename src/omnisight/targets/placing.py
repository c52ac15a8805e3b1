"""Which board a grid of corners is, and which part of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from .boards.checkerboard import Checkerboard
from .detection import Detection
from .grids.grid import Grid
from .grids.search import find_grids

_LEAST_OPEN = 0.4
"""Part of a board's corners that a grid must have if it ends for no reason that is seen, as behind a hand."""

_LEAST_ENDED = 0.15
"""The same for a grid that ends everywhere at the board's margin or the image's."""

_FILLED = 0.9
"""Part of a grid's corners that must be there to take its size for a board's."""


def detect_checkerboards(gray: NDArray[np.uint8], board: Checkerboard) -> list[Detection]:
    """Find a checkerboard, each time it is seen in an image (H, W) of uint8, the one with most corners first.

    Every corner agrees with its neighbours and has the colours of one; the others are left out, so a result may hold
    part of the board. A grid that goes on beyond the board's size is another board.

    Raises
    ------
    ValueError
        If `gray` is not an 8-bit gray image.
    """
    placed = [place(grid, board) for grid in find_grids(gray)]
    return [detection for detection in placed if detection is not None]


def detect_checkerboard(gray: NDArray[np.uint8], board: Checkerboard) -> Detection | None:
    """Give the best of `detect_checkerboards`; None if there is none."""
    return next(iter(detect_checkerboards(gray, board)), None)


def place(grid: Grid, board: Checkerboard) -> Detection | None:
    """Give a grid the ids of a board's corners.

    Turned so that it fits and its colours agree; of the places that are left, the ends of the grid decide: where it
    ends at the board's margin, so does the board. Of two turns of a symmetric board the one that starts nearest the
    top left of the image is taken, which another image or camera may see elsewhere.

    Returns
    -------
    Detection or None
        None if the grid does not fit on the board, or is too little of it to be sure. Its `located` is False where
        several places are left.
    """
    share = len(grid) / board.size
    least = _LEAST_OPEN if "open" in grid.ends else _LEAST_ENDED
    if share < least:
        return None
    cells = np.arange(grid.there.size).reshape(grid.shape)
    places = [
        (score, turned, row, column, np.rot90(cells, quarters))
        for quarters in range(4)
        for score, turned, row, column in _places(grid.turned(quarters), board)
    ]
    if not places:
        return None
    best = max(score for score, *_ in places)
    detections: list[Detection] = []
    names: set[tuple[int, ...]] = set()
    for score, turned, row, column, order in places:
        if score == best:
            detection = _detection(turned, row, column, board)
            detections.append(detection)
            names.add(_canonical(detection.ids[np.argsort(order[turned.there])], board))
    first = min(detections, key=lambda d: float(d.pixels[0].sum()))
    return Detection(first.ids, first.pixels, first.covariance, located=len(names) == 1, board=board)


def _places(grid: Grid, board: Checkerboard) -> Iterable[tuple[int, Grid, int, int]]:
    """Give the places (score, grid, first row, first column) where a grid fits on a board by its colours."""
    rows, columns = grid.shape
    top, bottom, left, right = (end == "margin" for end in grid.ends)
    if (top and bottom and rows < board.rows) or (left and right and columns < board.columns):
        return  # all of a smaller board
    # A symmetric board may be printed either way round, dark square first or bright; but where a quarter turn exchanges
    # them a dark one can always come first.
    coloured = not board.symmetric or (board.columns == board.rows and board.columns % 2 == 1)
    for row in range(board.rows - rows + 1):
        for column in range(board.columns - columns + 1):
            if not coloured or grid.dark == ((row + column) % 2 == 0):
                ended = (
                    (top and row == 0)
                    + (bottom and row + rows == board.rows)
                    + (left and column == 0)
                    + (right and column + columns == board.columns)
                )
                yield ended, grid, row, column


def _detection(grid: Grid, row: int, column: int, board: Checkerboard) -> Detection:
    i, j = np.nonzero(grid.there)
    return Detection((i + row) * board.columns + j + column, grid.pixels[i, j], grid.covariance[i, j])


def _canonical(ids: NDArray[np.int64], board: Checkerboard) -> tuple[int, ...]:
    """Give the ids of a grid's corners, in the grid's own order, or what a turn of the board onto itself makes of them.

    The least of these: one key for all places that no image can tell apart.
    """
    turns = [ids]
    if board.symmetric:
        turns.append(board.size - 1 - ids)
        if board.columns == board.rows and board.columns % 2 == 0:  # a quarter turn keeps the colours: square in middle
            i, j = np.divmod(ids, board.columns)
            quarter = j * board.columns + board.columns - 1 - i
            turns += [quarter, board.size - 1 - quarter]
    return min(tuple(turn.tolist()) for turn in turns)


def agreed_pattern(pictures: Sequence[Sequence[Grid]]) -> tuple[int, int] | None:
    """Give the (columns, rows), columns >= rows, of the board that most images show; None if none shows any.

    Grids that end at a margin all around count before others; without any of either, the largest grid is taken.
    """
    whole: Counter[tuple[int, int]] = Counter()
    for grids in pictures:
        for columns, rows in {pattern_of(grid) for grid in grids if _filled(grid)}:
            whole[columns, rows] += 1
        for columns, rows in {pattern_of(grid) for grid in grids if _filled(grid) and set(grid.ends) == {"margin"}}:
            whole[columns, rows] += 2
    if not whole:
        return max((pattern_of(grid) for grids in pictures for grid in grids), default=None)
    return max(whole, key=lambda size: (whole[size], size[0] * size[1]))


def pattern_of(grid: Grid) -> tuple[int, int]:
    """Give a grid's columns and rows, columns >= rows."""
    return max(grid.shape), min(grid.shape)


def _filled(grid: Grid) -> bool:
    return len(grid) >= _FILLED * grid.there.size
