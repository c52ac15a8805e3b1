"""What images can be taken with."""

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.geometry.rays import Rays


class RenderableCamera(Protocol):
    """A camera, central or not: `Camera`, `RayCamera`, or anything that gives this. Lengths are in metres."""

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the image, px."""
        ...

    def rays(self, pixels: ArrayLike, /) -> Rays:
        """Give the rays of pixels (..., 2) in the camera's frame, NaN where not valid."""
        ...

    def project(self, points: ArrayLike, /) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Give the pixels (..., 2) of points (..., 3) of the camera's frame, and whether they are valid."""
        ...
