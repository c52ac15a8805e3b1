"""Detectors: each package of this folder detects and measures the boards whose `detector` names it.

A detector has two functions, with the arguments of `detect` and `measure` here.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.extensions import module_in
from omnisight.targets.boards import Board
from omnisight.targets.detections import Detection
from omnisight.targets.observation_checks import are_collinear
from omnisight.targets.subpixel.point_fits import PointFits


def detect(gray: NDArray[np.uint8], board: Board) -> list[Detection]:
    """Detect all boards of this kind in a gray image (H, W) of uint8, the one with most points first.

    A board is left out if its visible points lie on one line: they do not determine its pose.

    Raises
    ------
    ValueError
        If `gray` is not an 8-bit gray image.
    """
    if gray.ndim != 2 or gray.dtype != np.uint8:
        raise ValueError(f"expected a gray image (H, W) of uint8, got shape {gray.shape} of {gray.dtype}")
    detections: list[Detection] = _detector(board).detect(gray, board)
    return [each for each in detections if not are_collinear(board.points[each.ids], each.pixels)]


def measure(
    gray: NDArray[Any],
    board: Board,
    pixels: NDArray[np.float64],
    steps: NDArray[np.float64],
    bends: NDArray[np.float64],
) -> PointFits:
    """Measure points near their predicted pixels, such as those of a calibrated camera.

    Parameters
    ----------
    gray : (H, W) array of uint8
    board : Board
    pixels : (N, 2) array
        Predicted pixels.
    steps : (N, 2, 2) array
        Steps in px for `board.window_step` along x (first row) and along y.
    bends : (N, 2, 2) array
        Curvature of the lines along x and y: one runs through c + s step + s^2 bend.
    """
    return _detector(board).measure(gray, board, pixels, steps, bends)


def _detector(board: Board) -> Any:
    return module_in(__name__, board.detector, "detector")
