"""Boards of every kind, and their shapes painted on paper."""

import cv2
import numpy as np
import pytest

from omnisight.targets.boards import board_class
from omnisight.targets.printing.drawing import Disc

checkerboard, charuco, aprilgrid, aruco_grid, circles, symmetric_circles = (
    board_class(kind) for kind in ("checkerboard", "charuco", "aprilgrid", "aruco_grid", "circles", "symmetric_circles")
)
EXAMPLES = {
    "checkerboard": [checkerboard(9, 6, 0.03), checkerboard(8, 6, 0.02), checkerboard(6, 6, 0.02)],
    "charuco": [
        charuco(9, 6, 0.03, 0.022),
        charuco(6, 9, 0.03, 0.022, "DICT_4X4_50", legacy=True),
        charuco(5, 5, 0.03, 0.02, "DICT_6X6_250", legacy=True),
        charuco(4, 3, 0.05, 0.04, "DICT_APRILTAG_36h11"),
    ],
    "aprilgrid": [aprilgrid(6, 6, 0.03, 0.3), aprilgrid(3, 2, 0.05, 0.2), aprilgrid(1, 1, 0.05, 1.0)],
    "aruco_grid": [aruco_grid(6, 4, 0.03, 0.006, "DICT_6X6_50"), aruco_grid(1, 1, 0.05, 0.01)],
    "circles": [circles(4, 11, 0.02, 0.016), circles(3, 8, 0.03, 0.03), circles(7, 7, 0.02, 0.02)],
    "symmetric_circles": [symmetric_circles(7, 5, 0.03, 0.018), symmetric_circles(5, 5, 0.02, 0.012)],
}
BOARDS = [pytest.param(board, id=f"{kind}-{board}") for kind, boards in EXAMPLES.items() for board in boards]
SCALE = 1200.0  # px per metre: about 30 dpi, no more than a camera sees
FINE = 8


def rasterise(shapes, width, height, scale=SCALE):
    """Paint shapes, in metres from the top left corner, on white paper; each pixel is the mean over its square."""
    size = (round(height * scale), round(width * scale))
    fine = np.full((size[0] * FINE, size[1] * FINE), 255, np.uint8)
    for shape in shapes:
        if isinstance(shape, Disc):
            turn = np.linspace(0, 2 * np.pi, 181)[:-1]
            corners = np.stack([np.cos(turn), np.sin(turn)], axis=1) * shape.radius + shape.centre
        else:
            corners = np.array(shape.corners)
        fixed = np.round((corners * scale * FINE - 0.5) * 256).astype(np.int32)
        cv2.fillPoly(fine, [fixed], 255 if shape.white else 0, shift=8)
    return cv2.resize(fine, size[::-1], interpolation=cv2.INTER_AREA)
