"""An ellipse in a picture: where a lens or a mirror ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class Ellipse:
    """An ellipse in pixel coordinates; a circle where both axes are equal.

    Parameters
    ----------
    centre : (u, v) px
    axes : (a, b) px
        Semi-axes.
    angle : float
        Radians from +u towards +v to the first axis.
    """

    centre: tuple[float, float]
    axes: tuple[float, float]
    angle: float = 0.0

    @classmethod
    def from_matrix(cls, centre: ArrayLike, matrix: ArrayLike) -> Ellipse:
        """Make the ellipse onto which `centre + matrix @ (cos t, sin t)` maps the unit circle."""
        turn, axes, _ = np.linalg.svd(np.asarray(matrix, float))
        u, v = np.asarray(centre, float)
        angle = np.arctan2(turn[1, 0], turn[0, 0])
        angle = (angle + np.pi / 2) % np.pi - np.pi / 2  # an axis has no direction
        return cls((float(u), float(v)), (float(axes[0]), float(axes[1])), float(angle))

    @property
    def matrix(self) -> NDArray[np.float64]:
        """(2, 2): maps the unit circle onto the ellipse around (0, 0)."""
        cosine, sine = np.cos(self.angle), np.sin(self.angle)
        return np.array([[cosine, -sine], [sine, cosine]]) * self.axes

    @property
    def radius(self) -> float:
        """Radius in px of the circle of equal area."""
        return float(np.sqrt(self.axes[0] * self.axes[1]))

    def level(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Give how far out pixels (..., 2) lie: 0 at the centre, 1 on the border, linear along each ray."""
        away = np.asarray(pixels, float) - self.centre
        along = away @ np.linalg.inv(self.matrix).T
        return np.hypot(along[..., 0], along[..., 1])

    def contains(self, pixels: ArrayLike) -> NDArray[np.bool_]:
        """Tell which pixels (..., 2) lie inside or on the border; NaN does not."""
        return np.asarray(self.level(pixels) <= 1)

    def outline(self, n: int = 360) -> NDArray[np.float64]:
        """Give `n` pixels (n, 2) along the border."""
        turn = np.arange(n) * (2 * np.pi / n)
        return np.stack([np.cos(turn), np.sin(turn)], axis=-1) @ self.matrix.T + self.centre

    def grown(self, px: float) -> Ellipse:
        """Move the border outwards by `px`, or inwards where negative; axes stay above zero."""
        a, b = (max(axis + px, 1e-9) for axis in self.axes)
        return Ellipse(self.centre, (a, b), self.angle)
