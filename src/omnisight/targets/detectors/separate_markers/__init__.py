"""Detect grids of separate markers: markers are decoded, then their sides are fitted and intersected."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.boards._aruco import marker_cells
from omnisight.targets.boards.aruco_grid import ArucoGrid
from omnisight.targets.detection_limits import MIN_EXPLAINED, MIN_RELATIVE_CONTRAST
from omnisight.targets.detections import Detection
from omnisight.targets.detectors.markers.decoding import decode_markers, select_board_markers
from omnisight.targets.detectors.separate_markers.marker_corners import fit_marker_corners
from omnisight.targets.subpixel.point_fits import PointFits

Array = NDArray[np.float64]

# Markers that a detection needs, if the board has as many.
MIN_MARKERS = 2
# Standard deviation, px, above which a corner is worthless.
MAX_SIGMA_PX = 0.4


def detect(gray: NDArray[np.uint8], board: ArucoGrid) -> list[Detection]:
    """Detect a grid of markers, printed black on white, or white on black.

    In a mirror image, as a camera sees a board in a mirror, ids are right. Markers whose cells are smaller than about
    2 px are left out.

    Returns
    -------
    list of Detection
        One, or none.
    """
    detection = _detect_black_on_white(gray, board) or _detect_black_on_white(255 - gray, board)
    return [] if detection is None else [detection]


def measure(gray: NDArray[Any], board: ArucoGrid, pixels: Array, steps: Array, bends: Array) -> PointFits:
    """Measure the corners of all markers near predicted pixels (4 x markers, 2).

    A side is where the corners at its ends are, so `steps` and `bends` are not needed.
    """
    del steps, bends
    numbers = range(board.first_marker, board.first_marker + board.columns * board.rows)
    cells = np.stack([marker_cells(board.dictionary, number) for number in numbers])
    return fit_marker_corners(gray, pixels.reshape(-1, 4, 2), cells, _gaps(board))


def _gaps(board: ArucoGrid) -> Array:
    """Return the gap (markers, 4) above, right, below and left of each marker in cells; inf where the board ends."""
    row, column = np.divmod(np.arange(board.columns * board.rows), board.columns)
    ends = np.stack([row == 0, column == board.columns - 1, row == board.rows - 1, column == 0], axis=1)
    return np.where(ends, np.inf, board.separation / board.cell)


def _detect_black_on_white(gray: NDArray[np.uint8], board: ArucoGrid) -> Detection | None:
    """Detect a grid of black markers."""
    on_board = board.marker_corners
    count = len(on_board)
    markers = decode_markers(
        gray,
        board.dictionary,
        range(board.first_marker, board.first_marker + count),
        1,
        lambda decoded: len(select_board_markers(decoded, on_board).ids) == count,
    )
    markers = select_board_markers(markers, on_board)
    if len(markers.ids) < min(MIN_MARKERS, count):
        return None
    start = np.full((count, 4, 2), np.nan)
    start[markers.ids] = markers.corners
    start = start.reshape(-1, 2)
    fits = measure(gray, board, start, *np.zeros((2, len(start), 2, 2)))
    cell = np.repeat(np.linalg.norm(np.diff(start.reshape(-1, 4, 2), axis=1), axis=2).max(axis=1), 4)
    cell *= board.cell / board.marker
    good = (fits.explained > MIN_EXPLAINED) & (np.linalg.norm(fits.pixels - start, axis=1) < np.maximum(cell, 1.0))
    good &= (np.trace(fits.covariance, axis1=1, axis2=2) < MAX_SIGMA_PX**2) & (fits.amplitude > 0)
    if not good.any():
        return None
    good &= fits.amplitude > MIN_RELATIVE_CONTRAST * np.median(fits.amplitude[good])
    return Detection(np.flatnonzero(good), fits.pixels[good], fits.covariance[good], board=board)
