"""Bird's-eye views: an orthographic camera above the ground, which may bend up to a bowl further away."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.display import Displayed

Array = NDArray[np.float64]

# Sides of a view, px: the resolution is that of neighbouring pixels, and larger sides are a wrong unit of the lengths.
MIN_SIDE_PX, MAX_SIDE_PX = 2, 16384


@dataclass(frozen=True)
class Bowl(Displayed):
    """A surface that is flat around the vehicle and rises as a parabola further away.

    At a distance d from the flat rectangle the height is d^2 / (2 radius): slope 1 at d = radius.

    Attributes
    ----------
    half_size
        Half the width and half the length (metres) of the flat rectangle around the origin.
    radius
        Radius of curvature of the parabola at its vertex, metres.
    """

    half_size: tuple[float, float]
    radius: float

    def height(self, ground: ArrayLike) -> Array:
        """Return the height (...) above the ground, metres, at positions (..., 2) right and forward."""
        beyond = np.maximum(np.abs(np.asarray(ground, float)) - self.half_size, 0.0)
        return (beyond**2).sum(-1) / (2 * self.radius)


@dataclass(frozen=True)
class GroundView(Displayed):
    """An orthographic view of the ground from above: forward is up, right is right.

    Positions on the ground are (right, forward), metres. In the ground frame (x right, y down, z forward; the ground
    is y = 0) they are (right, 0, forward).

    Attributes
    ----------
    meters_per_pixel
        Side of a pixel on the ground.
    extent
        (left, right, back, front): limits of the view, metres.
    bowl
        The surface that is seen; None for the plane.
    """

    meters_per_pixel: float
    extent: tuple[float, float, float, float]
    bowl: Bowl | None = None

    def __post_init__(self) -> None:
        left, right, back, front = self.extent
        if not (left < right and back < front):
            raise ValueError(f"the extent must be left < right, back < front, got {self.extent}")
        if not self.meters_per_pixel > 0:
            raise ValueError(f"meters_per_pixel must be positive, got {self.meters_per_pixel:g}")
        if not MIN_SIDE_PX <= min(self.size) <= max(self.size) <= MAX_SIDE_PX:
            raise ValueError(
                f"the view has {self.size[0]}x{self.size[1]} px; choose metres per pixel (--pixel) and an"
                f" extent (--margin) for {MIN_SIDE_PX} to {MAX_SIDE_PX} px per side"
            )

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the view, px."""
        left, right, back, front = self.extent
        return round((right - left) / self.meters_per_pixel), round((front - back) / self.meters_per_pixel)

    def ground(self, pixels: ArrayLike) -> Array:
        """Return the positions (..., 2) right and forward, metres, of pixels (..., 2)."""
        p = np.asarray(pixels, float)
        left, _, _, front = self.extent
        return np.stack(
            [left + (p[..., 0] + 0.5) * self.meters_per_pixel, front - (p[..., 1] + 0.5) * self.meters_per_pixel], -1
        )

    def pixels(self, ground: ArrayLike) -> Array:
        """Return the pixels (..., 2) of positions (..., 2) right and forward, metres."""
        g = np.asarray(ground, float)
        left, _, _, front = self.extent
        return np.stack([g[..., 0] - left, front - g[..., 1]], -1) / self.meters_per_pixel - 0.5

    def points(self) -> Array:
        """Return the points (H, W, 3) of the surface in the ground frame that the pixels show."""
        width, height = self.size
        ground = self.ground(np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1))
        rise = np.zeros(ground.shape[:2]) if self.bowl is None else self.bowl.height(ground)
        return np.stack([ground[..., 0], -rise, ground[..., 1]], -1)
