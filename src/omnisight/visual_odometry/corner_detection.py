"""Corners where no patch is tracked, one per cell of equal solid angle."""

import numpy as np
from numpy.typing import NDArray

from omnisight.parallel import parallel_for
from omnisight.visual_odometry.solid_angle_cells import SolidAngleCells

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]

# Standard deviation (px) of the position of a corner above which it is of no use, for noise of 2 of 255: an image of
# nothing but that noise has corners of 0.26 px.
MAX_SIGMA_PX = 0.12
# Standard deviation of the noise of an image of 8 bits.
IMAGE_NOISE = 2.0
# The eigenvalues of the structure tensor are the information of the position, for noise of 1.
MIN_EIGENVALUE = (IMAGE_NOISE / MAX_SIGMA_PX) ** 2
# Rows for which another thread is worth its start.
GRAIN = 128


def detect_corners(gray: Bytes, cells: SolidAngleCells, occupied: Array) -> Array:
    """Detect the best corner of each cell that has none.

    Parameters
    ----------
    gray
        (H, W).
    cells
        The cells, which also mask pixels.
    occupied
        (N, 2) pixels of patches.

    Returns
    -------
    (K, 2) pixels, in the order of their cells.
    """
    from omnisight.visual_odometry._corner_kernel import best_corners, score_corners

    held = cells.at(occupied)
    wanted = np.bincount(held[held >= 0], minlength=cells.count) == 0
    gray, score = np.ascontiguousarray(gray), np.empty(gray.shape, np.float32)
    parallel_for(lambda first, last: score_corners(gray, score, first, last), len(gray), GRAIN)
    corners = np.empty((cells.count, 2), np.int64)
    best_corners(score, cells.of_pixel, occupied, wanted, MIN_EIGENVALUE, corners)
    return corners[corners[:, 0] >= 0].astype(float)
