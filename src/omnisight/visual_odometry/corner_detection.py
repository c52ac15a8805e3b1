"""Corners where no patch is tracked, one per cell of equal solid angle."""

import numpy as np
from numpy.typing import NDArray

from omnisight.visual_odometry.solid_angle_cells import SolidAngleCells

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]

# Window of the structure tensor, as wide as a patch, and of the derivative.
WINDOW_PX, DERIVATIVE_PX = 9, 3
# Standard deviation (px) of the position of a corner above which it is of no use, for noise of 2 of 255: an image of
# nothing but that noise has corners of 0.26 px.
MAX_SIGMA_PX = 0.12
# Standard deviation of the noise of an image of 8 bits.
IMAGE_NOISE = 2.0
# cornerMinEigenVal divides twice the derivatives by 255 times the width of the window, and sums over the window.
MIN_EIGENVALUE = (IMAGE_NOISE / MAX_SIGMA_PX) ** 2 * (2.0 / (255.0 * WINDOW_PX)) ** 2
# Distance to the next corner, px: patches that overlap more see the same.
MIN_DISTANCE_PX = 7


def detect_corners(gray: Bytes, cells: SolidAngleCells, occupied: Array, per_cell: int = 1) -> Array:
    """Detect the best corner of each cell that has none.

    J. Shi and C. Tomasi, Good features to track, CVPR 1994.

    Parameters
    ----------
    gray
        (H, W).
    cells
        The cells, which also mask pixels.
    occupied
        (N, 2) pixels of patches.
    per_cell
        Number of corners wanted in each cell.

    Returns
    -------
    (K, 2) pixels.
    """
    import cv2

    score = cv2.cornerMinEigenVal(gray, WINDOW_PX, ksize=DERIVATIVE_PX)
    size = 2 * MIN_DISTANCE_PX + 1
    is_peak = (score >= cv2.dilate(score, np.ones((size, size), np.uint8))) & (score > MIN_EIGENVALUE)
    is_peak &= cells.of_pixel >= 0
    for column, row in np.rint(occupied).astype(int):
        top, left = max(row - MIN_DISTANCE_PX, 0), max(column - MIN_DISTANCE_PX, 0)
        is_peak[top : row + MIN_DISTANCE_PX + 1, left : column + MIN_DISTANCE_PX + 1] = False
    rows, columns = np.nonzero(is_peak)
    cell, value = cells.of_pixel[rows, columns], score[rows, columns]
    held = cells.at(occupied)
    missing = per_cell - np.bincount(held[held >= 0], minlength=cells.count)
    order = np.lexsort((-value, cell))
    sorted_cells = cell[order]
    rank = np.arange(len(order)) - np.searchsorted(sorted_cells, sorted_cells)
    chosen = order[rank < missing[sorted_cells]]
    return np.stack([columns[chosen], rows[chosen]], -1).astype(float)
