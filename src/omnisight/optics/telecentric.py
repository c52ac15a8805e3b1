"""The telecentric lens: orthographic projection along parallel rays."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.geometry.rays import Rays
from omnisight.models._arrays import as_rows
from omnisight.models._parameter import parameter
from omnisight.models._projector import Array
from omnisight.optics.ray_model import RayModel


@dataclass(frozen=True)
class Telecentric(RayModel):
    """A telecentric lens: the ray of a pixel starts in the plane z = 0 and is parallel to z.

    u = fx x + skew y + cx,  v = fy y + cy

    The central fisheye model r = sin(theta) is `omnisight.models.orthographic`.
    """

    fx: float = parameter("px per unit of length along x", unit="px/m")
    fy: float = parameter("px per unit of length along y", unit="px/m")
    cx: float = parameter("pixel column of the z axis", unit="px")
    cy: float = parameter("pixel row of the z axis", unit="px")
    skew: float = parameter("skew of the pixel axes", unit="px/m", default=0.0, free=False)

    @classmethod
    def example(cls) -> Self:
        return cls(fx=9800.0, fy=9810.0, cx=511.2, cy=384.9, skew=3.0)

    def rays(self, pixels: ArrayLike) -> Rays:
        """Return the rays (...) of pixels (..., 2): they start in the plane z = 0 and are parallel to z."""
        flat, lead = as_rows(pixels, 2, "pixels")
        y = (flat[:, 1] - self.cy) / self.fy
        x = (flat[:, 0] - self.cx - self.skew * y) / self.fx
        valid = np.isfinite(x) & np.isfinite(y)
        shown = np.where(valid, 1.0, np.nan)
        origins = np.stack([x * shown, y * shown, 0 * shown], -1)
        bearings = np.stack([0 * shown, 0 * shown, shown], -1)
        return Rays(origins.reshape(*lead, 3), bearings.reshape(*lead, 3), valid.reshape(lead))

    def project(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Project points (..., 3) to pixels (..., 2); points with z < 0 are not valid."""
        pixels, valid, _, _ = self.project_with_jacobians(points)
        return pixels, valid

    def project_with_jacobians(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_], Array, Array]:
        flat, lead = as_rows(points, 3, "points")
        x, y, z = flat.T
        with np.errstate(invalid="ignore"):
            pixels = np.stack([self.fx * x + self.skew * y + self.cx, self.fy * y + self.cy], -1)
            valid = (z >= 0) & np.isfinite(pixels).all(-1)
        shown = np.where(valid, 1.0, np.nan)
        d_point = np.array([[self.fx, self.skew, 0.0], [0.0, self.fy, 0.0]]) * shown[:, None, None]
        zero, one = np.zeros_like(x), np.ones_like(x)
        d_params = np.array([[x, zero, one, zero, y], [zero, y, zero, one, zero]])
        d_params = np.moveaxis(d_params, -1, 0) * shown[:, None, None]
        return (
            pixels.reshape(*lead, 2) * shown.reshape(*lead, 1),
            valid.reshape(lead),
            d_point.reshape(*lead, 2, 3),
            d_params.reshape(*lead, 2, 5),
        )
