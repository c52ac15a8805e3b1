"""Non-central camera models: every pixel has its own ray."""

from numpy.typing import ArrayLike

from omnisight.geometry.rays import Rays
from omnisight.models import Projector

__all__ = ["RayModel"]


class RayModel(Projector):
    """A non-central camera model: its rays need not meet in a point, so the distance of a point matters.

    Lengths are in metres unless the caller defines another unit. `valid` means that the model sees the point, or that
    the pixel has a ray; invalid entries are NaN. `rim` is NaN: no angle bounds the domain of a non-central camera.
    """

    def rays(self, pixels: ArrayLike) -> Rays:
        """Return the rays (...) of pixels (..., 2) in the camera frame."""
        raise NotImplementedError
