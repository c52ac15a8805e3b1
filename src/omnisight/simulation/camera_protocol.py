"""The interface of cameras that images can be rendered with."""

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.geometry.rays import Rays


class RenderableCamera(Protocol):
    """A camera, central or not: `Camera`, `RayCamera`, or any object with this interface. Lengths are in metres."""

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the image, px."""
        ...

    def rays(self, pixels: ArrayLike, /) -> Rays:
        """Return the rays of pixels (..., 2) in the camera frame, NaN where not valid."""
        ...

    def project(self, points: ArrayLike, /) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Project points (..., 3) of the camera frame to pixels (..., 2) and their validity (...)."""
        ...
