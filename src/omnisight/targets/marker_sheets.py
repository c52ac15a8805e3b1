"""Where points and markers are on a board, and which other boards it may be mistaken for."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .boards.aprilgrid import AprilGrid
from .boards.charuco import Charuco

Array = NDArray[np.float64]


class Sheet(NamedTuple):
    """What the search needs to know of a board: all lengths in the unit of its points.

    Attributes
    ----------
    points : (N, 2) array
    bright : (N,) array of bool
        Whether the square between +x and +y of a point is the bright one.
    places : (M, 4, 2) array
        Corners of the markers.
    pitch : float
        Distance from a marker to the next.
    gap, step : float
        Least and largest distance between neighbouring points.
    board : Charuco or AprilGrid
    """

    points: Array
    bright: NDArray[np.bool_]
    places: Array
    pitch: float
    gap: float
    step: float
    board: Charuco | AprilGrid


def aprilgrid_sheet(board: AprilGrid) -> Sheet:
    """Give what the search needs to know of an AprilGrid."""
    points = board.points[:, :2]
    gap = board.spacing * board.tag
    return Sheet(points, board.bright, points[board.corners], board.pitch, gap, board.tag, board)


def charuco_sheet(board: Charuco) -> Sheet:
    """Give what the search needs to know of a ChArUco board."""
    side, half = board.square, board.marker / 2
    middles = (np.array(board.marker_squares, np.float64) - 0.5) * side
    places = middles[:, None] + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return Sheet(board.points[:, :2], board.bright, places, side, side, side, board)


def charuco_variants(board: Charuco) -> list[tuple[Charuco, NDArray[np.int64], str]]:
    """Give the board, and those that it may be mistaken for: each, the numbers of its points on the board, a note."""
    same = np.arange(board.size)
    variants = [(board, same, "")]
    layout = "the layout of OpenCV {} 4.6 (legacy: {})"
    swapped = replace(board, columns=board.rows, rows=board.columns)
    # A quarter turn takes the swapped board onto this one: x' and y' of the one are y and -x of the other.
    row, column = np.divmod(same, swapped.columns)
    turned = column * board.columns + board.columns - 1 - row
    for other, numbers, also in ((board, same, ""), (swapped, turned, f"columns and rows swapped ({swapped})")):
        for legacy in (board.legacy, not board.legacy):
            if other == board and legacy == board.legacy:
                continue
            if legacy != board.legacy and other.rows % 2 == 0:
                continue  # both layouts are the same
            if other is not board and board.columns == board.rows:
                continue
            told = layout.format(*(("before", "true") if legacy else ("since", "false")))
            said = ", and ".join(filter(None, (also, told if legacy != board.legacy else "")))
            variants.append((replace(other, legacy=legacy), numbers, f"the print has {said}"))
    return variants
