"""Ellipses in pixel coordinates: the boundary of an image circle or a mirror."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.display import Displayed


@dataclass(frozen=True)
class Ellipse(Displayed):
    """An ellipse in pixel coordinates; a circle if both axes are equal.

    Parameters
    ----------
    centre : (u, v) px
    axes : (a, b) px
        Semi-axes.
    angle : float
        Angle of the first axis, radians from +u towards +v.
    """

    centre: tuple[float, float]
    axes: tuple[float, float]
    angle: float = 0.0

    @classmethod
    def from_matrix(cls, centre: ArrayLike, matrix: ArrayLike) -> "Ellipse":
        """Return the image of the unit circle under `centre + matrix @ (cos t, sin t)`."""
        rotation, axes, _ = np.linalg.svd(np.asarray(matrix, float))
        u, v = np.asarray(centre, float)
        angle = np.arctan2(rotation[1, 0], rotation[0, 0])
        # An axis has no sign: reduce the angle to [-pi/2, pi/2).
        angle = (angle + np.pi / 2) % np.pi - np.pi / 2
        return cls((float(u), float(v)), (float(axes[0]), float(axes[1])), float(angle))

    @property
    def matrix(self) -> NDArray[np.float64]:
        """Matrix (2, 2) that maps the unit circle to the ellipse centred at (0, 0)."""
        cosine, sine = np.cos(self.angle), np.sin(self.angle)
        return np.array([[cosine, -sine], [sine, cosine]]) * self.axes

    @property
    def radius(self) -> float:
        """Radius of the circle of equal area, px."""
        return float(np.sqrt(self.axes[0] * self.axes[1]))

    def level(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Return the level (...) of pixels (..., 2): 0 at the centre, 1 on the ellipse, linear along each ray."""
        offset = np.asarray(pixels, float) - self.centre
        x, y = np.moveaxis(offset @ np.linalg.inv(self.matrix).T, -1, 0)
        return np.hypot(x, y)

    def contains(self, pixels: ArrayLike) -> NDArray[np.bool_]:
        """Return which pixels (..., 2) lie inside or on the ellipse; NaN does not."""
        return np.asarray(self.level(pixels) <= 1)

    def outline(self, n: int = 360) -> NDArray[np.float64]:
        """Return `n` pixels (n, 2) along the ellipse."""
        t = np.arange(n) * (2 * np.pi / n)
        return np.stack([np.cos(t), np.sin(t)], axis=-1) @ self.matrix.T + self.centre

    def grown(self, px: float) -> "Ellipse":
        """Return the ellipse with both semi-axes longer by `px` (shorter if negative, at least 1e-9)."""
        a, b = (max(axis + px, 1e-9) for axis in self.axes)
        return Ellipse(self.centre, (a, b), self.angle)
