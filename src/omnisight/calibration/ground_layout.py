"""Checkerboard squares on the ground, of any layout, and the detection of their corners in images of a rig."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.ground_calibration import GroundMarks, on_ground
from omnisight.rig import Rig, Sensor
from omnisight.targets.subpixel.corner_fit import fit_corners

Array = NDArray[np.float64]

BLACK, WHITE = "#", "."
# Share of the variance around a corner that the model of a corner must explain: the contrast of the squares exceeds
# wrinkles, shadows and dirt by far.
MIN_EXPLAINED = 0.8
# Shortest side of a square, px: a corner needs a window on each side of its edges.
MIN_SQUARE_PX = 6.0
# Largest shift of a corner from its predicted place, sides of a square: beyond, it may be the next one.
MAX_SHIFT_SQUARES = 0.35


@dataclass(frozen=True)
class GroundLayout:
    """Squares on the ground.

    Attributes
    ----------
    square
        Side of a square, metres.
    squares
        Rows of squares from front to back, and from left to right: "#" black, "." white, any other character for
        something else. The ground frame has its origin in the centre of all rows.
    """

    square: float
    squares: tuple[str, ...]

    def __post_init__(self) -> None:
        if not self.square > 0:
            raise ValueError(f"the side of a square must be positive, got {self.square:g}")
        if len({len(row) for row in self.squares}) != 1:
            lengths = ", ".join(sorted({str(len(row)) for row in self.squares}))
            raise ValueError(f"the rows of a ground layout must have the same length, got {lengths or 'no rows'}")

    def corners(self) -> tuple[Array, NDArray[np.bool_]]:
        """Return the positions (N, 2) right and forward of corners of four squares, and whether front left is black."""
        rows = np.array([list(row) for row in self.squares])
        left_front, right_front = rows[:-1, :-1], rows[:-1, 1:]
        left_back, right_back = rows[1:, :-1], rows[1:, 1:]
        falling = (left_front == BLACK) & (right_back == BLACK) & (right_front == WHITE) & (left_back == WHITE)
        rising = (left_front == WHITE) & (right_back == WHITE) & (right_front == BLACK) & (left_back == BLACK)
        row, column = np.nonzero(falling | rising)
        height, width = rows.shape
        right = (column + 1 - width / 2) * self.square
        forward = (height / 2 - row - 1) * self.square
        return np.stack([right, forward], -1), falling[row, column]


def detect_layout(layout: GroundLayout, grays: Sequence[NDArray[np.uint8]], rig: Rig) -> dict[str, GroundMarks]:
    """Detect the corners of a layout in the gray images of a rig, whose poses predict them to a third of a square.

    Parameters
    ----------
    layout
        The squares.
    grays
        Gray images (H, W), one for each camera.
    rig
        The rig in the ground frame.
    """
    ground, is_black = layout.corners()
    found: dict[str, GroundMarks] = {}
    for k, name in enumerate(rig.names):
        camera, pose = rig.cameras[k], rig.sensor_from_rig[k]
        ahead, aside = np.array([0.0, layout.square]), np.array([layout.square, 0.0])
        centre, before, after, left, right = (
            _project(camera, pose @ on_ground(ground + shift)) for shift in (np.zeros(2), ahead, -ahead, -aside, aside)
        )
        # The first step points to the right, the second to the back, as the columns and rows of the layout.
        steps = np.stack([(right - left) / 2, (after - before) / 2], axis=1)
        bends = np.stack([(right + left) / 2 - centre, (after + before) / 2 - centre], axis=1)
        length = np.linalg.norm(steps, axis=-1).min(axis=1)
        fits = fit_corners(grays[k], centre, steps, bends)
        with np.errstate(invalid="ignore"):
            shift = np.linalg.norm(fits.pixels - centre, axis=1)
            use = (length >= MIN_SQUARE_PX) & (shift <= MAX_SHIFT_SQUARES * length) & (fits.explained >= MIN_EXPLAINED)
            # The quadrant between the steps is back right, of the colour of front left.
            use &= (fits.amplitude < 0) == is_black
        found[name] = GroundMarks(fits.pixels[use], ground[use])
    return found


def _project(camera: Sensor, points: Array) -> Array:
    """Return the pixels (N, 2) of points of the camera frame; NaN outside the image."""
    pixels, valid = camera.project(points)
    return np.where((valid & camera.in_image(pixels))[:, None], pixels, np.nan)
