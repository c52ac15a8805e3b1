"""A grid of checkerboard corners detected in an image, before it is assigned to a board."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class CornerGrid:
    """Corners of one checkerboard, or of a part of it.

    The step to the next row is clockwise of the step to the next column as seen, x right and y down: one handedness
    for all images. A mirror in the light path mirrors every image of a camera alike, so all get one board frame.

    Attributes
    ----------
    pixels : (R, C, 2) array
        NaN where a corner is missing.
    covariance : (R, C, 2, 2) array
        Of `pixels`, px^2.
    starts_dark : bool
        Whether the square between the first two corners of the first two rows is a dark one.
    borders : tuple of 4 str
        What is past the first row, last row, first column and last column: 'margin' if the squares end and paper
        follows, 'cut' if the image or the image circle ends, 'open' if neither is visible.
    contrast, white : float
        Between bright and dark squares, and of the bright ones, in gray levels.
    blur : float
        Median standard deviation of the blur at its corners, px.
    """

    pixels: NDArray[np.float64]
    covariance: NDArray[np.float64]
    starts_dark: bool
    borders: tuple[str, str, str, str]
    contrast: float
    white: float
    blur: float

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.pixels.shape[0], self.pixels.shape[1]

    @property
    def present(self) -> NDArray[np.bool_]:
        """Which corners (R, C) are not missing."""
        return np.isfinite(self.pixels[..., 0])

    @property
    def pattern(self) -> tuple[int, int]:
        """Columns and rows as a pattern, the larger first."""
        return max(self.shape), min(self.shape)

    def __len__(self) -> int:
        """Return the number of corners."""
        return int(self.present.sum())

    def rotated(self, quarters: int) -> "CornerGrid":
        """Return the grid with rows and columns rotated by quarter turns, as `numpy.rot90` does."""
        top, bottom, left, right = self.borders
        clockwise = (top, right, bottom, left)
        top, right, bottom, left = (clockwise[(k + quarters) % 4] for k in range(4))
        # The new first square is the one at the corner that the rotation brings to the top left.
        rows, columns = self.shape
        steps = (0, columns, rows + columns, rows)[quarters % 4]
        return replace(
            self,
            pixels=np.rot90(self.pixels, quarters),
            covariance=np.rot90(self.covariance, quarters),
            starts_dark=self.starts_dark == (steps % 2 == 0),
            borders=(top, bottom, left, right),
        )

    def resized(self, scale: NDArray[np.float64] | float) -> "CornerGrid":
        """Return the grid in the image enlarged by `scale`, one number or one each along u and v."""
        scale = np.broadcast_to(np.asarray(scale, float), 2)
        return replace(
            self,
            pixels=(self.pixels + 0.5) * scale - 0.5,
            covariance=self.covariance * np.outer(scale, scale),
            blur=self.blur * float(scale.mean()),
        )
