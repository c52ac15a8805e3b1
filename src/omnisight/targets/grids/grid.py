"""A grid of checkerboard corners found in an image, before anyone knows which board it is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

ENDS = ("top", "bottom", "left", "right")


@dataclass(frozen=True, eq=False)
class Grid:
    """Corners of one checkerboard, or of a part of it.

    The step to the next row is clockwise of the step to the next column as seen, x right and y down: one handedness
    for all images. A mirror in the light path mirrors every image of a camera alike, so all get one board frame.

    Attributes
    ----------
    pixels : (R, C, 2) array
        NaN where a corner is missing.
    covariance : (R, C, 2, 2) array
        Of `pixels`, px^2.
    dark : bool
        Whether the square between the first two corners of the first two rows is a dark one.
    ends : tuple of 4 str
        How it ends past the first row, last row, first column and last column: 'margin' where the squares end and
        paper follows, 'cut' where the image or what the lens shows of it ends, 'open' where that is not to be seen.
    contrast, white : float
        Between bright and dark squares, and of the bright ones, in gray levels.
    blur : float
        Median standard deviation of the blur at its corners, px.
    """

    pixels: NDArray[np.float64]
    covariance: NDArray[np.float64]
    dark: bool
    ends: tuple[str, str, str, str]
    contrast: float
    white: float
    blur: float

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.pixels.shape[0], self.pixels.shape[1]

    @property
    def there(self) -> NDArray[np.bool_]:
        """Which corners (R, C) were found."""
        return np.isfinite(self.pixels[..., 0])

    def __len__(self) -> int:
        """Count the corners that were found."""
        return int(self.there.sum())

    def turned(self, quarters: int) -> Grid:
        """Give it with rows and columns turned by so many quarter turns, as `numpy.rot90` does."""
        top, bottom, left, right = self.ends
        ends = (top, right, bottom, left)  # as they follow each other around
        top, right, bottom, left = (ends[(k + quarters) % 4] for k in range(4))
        pixels = np.rot90(self.pixels, quarters)
        # What becomes the first square: the one at the corner that a quarter turn brings to the top left.
        rows, columns = self.shape
        moved = (0, columns, rows + columns, rows)[quarters % 4]
        return Grid(
            pixels,
            np.rot90(self.covariance, quarters),
            self.dark == (moved % 2 == 0),
            (top, bottom, left, right),
            self.contrast,
            self.white,
            self.blur,
        )

    def enlarged(self, factor: float) -> Grid:
        """Give it for the same image, so many times as large."""
        pixels = (self.pixels + 0.5) * factor - 0.5
        return replace(self, pixels=pixels, covariance=self.covariance * factor**2, blur=self.blur * factor)
