"""Image pyramids of a camera, padded at the seam of a 360° image."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]

# Each halves the size: a displacement of 8 px of a frame is one of 1 px on the coarsest level.
LEVELS = 4
# Columns that are repeated on both sides of the seam: half a patch of the coarsest level, and a multiple of its pixel.
SEAM_PX = 64


@dataclass(frozen=True, eq=False)
class ImagePyramid:
    """An image and its reductions.

    Attributes
    ----------
    levels
        Each has half the size of the one before, and the same pixel (0, 0).
    period
        Width (px) after which the image repeats, or 0.
    """

    levels: tuple[Bytes, ...]
    period: int = 0

    @classmethod
    def of(cls, gray: Bytes, camera: Camera) -> "ImagePyramid":
        """Build the pyramid of an image of a camera."""
        import cv2

        period = round(camera.model.period or 0)
        is_closed = period == camera.width
        image = np.pad(gray, ((0, 0), (SEAM_PX, SEAM_PX)), mode="wrap") if is_closed else np.ascontiguousarray(gray)
        levels = [image]
        for _ in range(LEVELS - 1):
            levels.append(np.asarray(cv2.pyrDown(levels[-1]), np.uint8))
        return cls(tuple(levels), period if is_closed else 0)

    def inside(self, pixels: Array) -> Array:
        """Return positions (N, 2) in the levels of pixels (N, 2) of the image."""
        if not self.period:
            return np.array(pixels, float)
        return np.stack([np.mod(pixels[:, 0] + 0.5, self.period) - 0.5 + SEAM_PX, pixels[:, 1]], -1)

    def outside(self, positions: Array) -> Array:
        """Return the pixels (N, 2) of positions (N, 2) in the levels."""
        if not self.period:
            return positions
        return np.stack([np.mod(positions[:, 0] - SEAM_PX + 0.5, self.period) - 0.5, positions[:, 1]], -1)
