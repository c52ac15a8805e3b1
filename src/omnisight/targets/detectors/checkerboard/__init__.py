"""Detect checkerboards: saddle points, grown to lattices, measured and completed, then assigned to a board."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.boards.checkerboard import Checkerboard
from omnisight.targets.detections import Detection
from omnisight.targets.detectors.checkerboard.board_assignment import assign_to_board
from omnisight.targets.detectors.checkerboard.grid_search import find_grids
from omnisight.targets.subpixel.corner_fit import fit_corners
from omnisight.targets.subpixel.point_fits import PointFits


def detect(gray: NDArray[np.uint8], board: Checkerboard) -> list[Detection]:
    """Detect a checkerboard as often as it is seen, the one with most corners first.

    Corners that are inconsistent with their neighbours or their colours are left out, so a result may hold part of
    the board. A grid that exceeds the board's size is another board.
    """
    assigned = [assign_to_board(grid, board) for grid in find_grids(gray)]
    return [detection for detection in assigned if detection is not None]


def measure(
    gray: NDArray[Any],
    board: Checkerboard,
    pixels: NDArray[np.float64],
    steps: NDArray[np.float64],
    bends: NDArray[np.float64],
) -> PointFits:
    """Measure the crossings of edges near predicted pixels."""
    return fit_corners(gray, pixels, steps, bends)
