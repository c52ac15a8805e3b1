"""Cylindrical projections: the column is the longitude, the row a function of the latitude."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from omnisight.models._camera_model import CameraModel
from omnisight.models._elementwise import absolute, clipped, model_method, signed_atan2, signed_sine_cosine, sqrt
from omnisight.models._parameter import parameter
from omnisight.models._projector import Array


@model_method
def cylinder_height(m: Any, y: Any, q: Any) -> Any:
    """Return the height h on the cylinder of y/q with q = hypot(x, z)."""


@model_method
def inverse_cylinder_height(m: Any, h: Any) -> Any:
    """Return (cos, sin) of the angle below the horizon, and its validity, from the height."""


@dataclass(frozen=True)
class CylindricalProjection(CameraModel):
    """u = fx lon + cx with lon = atan2(x, z), and v = fy h(t) + cy with t = y/hypot(x, z); a subclass implements h."""

    fx: float = parameter("pixels per radian of longitude", unit="px")
    fy: float = parameter("pixels per unit of height", unit="px")
    cx: float = parameter("column of longitude 0", unit="px")
    cy: float = parameter("row of the horizon", unit="px")

    @staticmethod
    def cylinder_height(m: Any, y: Any, q: Any) -> Any:
        """Return h, positive below the horizon."""
        raise NotImplementedError

    @staticmethod
    def inverse_cylinder_height(m: Any, h: Any) -> Any:
        """Return (cosine, sine) of the angle below the horizon, and whether the height is valid."""
        raise NotImplementedError

    @staticmethod
    def cylinder_height_derivative(t: Array) -> Array:
        """Return dh/dt."""
        raise NotImplementedError

    @staticmethod
    def project_point(m: Any, x: Any, y: Any, z: Any, max_iterations: Any) -> Any:
        q = sqrt(x * x + z * z)
        h = cylinder_height(m, y, q)
        valid = (absolute(h) < np.inf) & (q + absolute(y) < np.inf)
        return m.fx * signed_atan2(x, z) + m.cx, m.fy * h + m.cy, valid

    @staticmethod
    def unproject_pixel(m: Any, u: Any, v: Any, max_iterations: Any) -> Any:
        longitude = (u - m.cx) / m.fx
        # Half a pixel beyond 180 degrees lies on the other side of the seam.
        valid = absolute(longitude) <= 3.141592653589793 * (1.0 + 1e-12)
        s, c = signed_sine_cosine(clipped(longitude, 3.141592653589793))
        level, down, inside = inverse_cylinder_height(m, (v - m.cy) / m.fy)
        return s * level, down, c * level, valid & inside

    def derivatives(self, points: Array) -> tuple[Array, NDArray[np.bool_], Array, Array]:
        x, y, z = points.T
        q2 = x * x + z * z
        q = np.sqrt(q2)
        t = y / q
        longitude = np.arctan2(x, z)
        h = self.cylinder_height(self, y, q)
        pixels = np.stack([self.fx * longitude + self.cx, self.fy * h + self.cy], -1)
        valid = np.isfinite(h) & np.isfinite(q + y)
        slope = self.fy * self.cylinder_height_derivative(t)
        d_point = np.zeros((len(points), 2, 3))
        d_point[:, 0, 0], d_point[:, 0, 2] = self.fx * z / q2, -self.fx * x / q2
        d_point[:, 1, 0], d_point[:, 1, 1], d_point[:, 1, 2] = (
            -slope * t * x / q2,
            slope / q,
            -slope * t * z / q2,
        )
        d_params = np.zeros((len(points), 2, 4))
        d_params[:, 0, 0], d_params[:, 0, 2] = longitude, 1.0
        d_params[:, 1, 1], d_params[:, 1, 3] = h, 1.0
        return pixels, valid, d_point, d_params

    @property
    def period(self) -> float:
        return 2 * np.pi * self.fx

    @classmethod
    def initial_models(cls, bearings: Array, pixels: Array) -> Iterator[Self]:
        """Return a linear fit of both axes to the directions far from the seam."""
        x, y, z = bearings.T
        longitude = np.arctan2(x, z)
        with np.errstate(all="ignore"):
            h = cls.cylinder_height(None, y, np.hypot(x, z))
        use = np.isfinite(h) & (np.abs(longitude) < 3.0)
        one = np.ones(use.sum())
        fx, cx = np.linalg.lstsq(np.stack([longitude[use], one], -1), pixels[use, 0], rcond=None)[0]
        fy, cy = np.linalg.lstsq(np.stack([h[use], one], -1), pixels[use, 1], rcond=None)[0]
        yield cls(float(fx), float(fy), float(cx), float(cy))

    @classmethod
    def example(cls) -> Self:
        return cls(fx=1024 / (2 * np.pi), fy=1024 / (2 * np.pi), cx=511.5, cy=255.5)
