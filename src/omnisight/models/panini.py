"""The Panini view."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from omnisight.models._camera_model import CameraModel
from omnisight.models._elementwise import absolute, sqrt, where
from omnisight.models._parameter import parameter
from omnisight.models._projector import Array


@dataclass(frozen=True)
class Panini(CameraModel):
    """The general Panini projection: a cylinder seen from d behind its axis.

    With lon = atan2(x, z), t = y/hypot(x, z) and S = (d + 1)/(d + cos(lon)):
    u = fx S sin(lon) + cx,  v = fy S t + cy

    Upright lines stay straight, and so do lines that run into the image centre. d = 0 is a perspective, d = 1 the
    classic Panini. Valid where cos(lon) > -d, and for d > 1 where cos(lon) > -1/d. Sharpless, Postle and German,
    Pannini: a new projection for rendering wide angle perspective images, CAe 2010.
    """

    auto_max_theta: ClassVar[float] = 0.0

    fx: float = parameter("focal length along x", unit="px")
    fy: float = parameter("focal length along y", unit="px")
    cx: float = parameter("principal point", unit="px")
    cy: float = parameter("principal point", unit="px")
    d: float = parameter("distance of the eye behind the axis, in radii", low=0.0, default=1.0)

    def projection_constants(self) -> dict[str, Any]:
        # Just inside: at the limit itself the image is infinitely wide, or not injective.
        limit = -self.d if self.d <= 1 else -1 / self.d
        return {"cos_min": limit + 1e-6, "cos_back": limit}

    @staticmethod
    def project_point(m: Any, x: Any, y: Any, z: Any, max_iterations: Any) -> Any:
        q = sqrt(x * x + z * z)
        c = z / q
        stretch = (m.d + 1.0) / (m.d + c)
        valid = (c > m.cos_min) & (q + absolute(y) < np.inf)
        return m.fx * stretch * (x / q) + m.cx, m.fy * stretch * (y / q) + m.cy, valid

    @staticmethod
    def unproject_pixel(m: Any, u: Any, v: Any, max_iterations: Any) -> Any:
        # With k = u^2/(d + 1)^2: cos(lon) is the larger root of (1 + k) c^2 + 2 k d c + k d^2 - 1 = 0.
        a, b = (u - m.cx) / m.fx, (v - m.cy) / m.fy
        k = (a / (m.d + 1.0)) ** 2
        under = 1.0 + k * (1.0 - m.d * m.d)
        c = (sqrt(where(under > 0.0, under, 0.0)) - k * m.d) / (1.0 + k)
        scale = (m.d + c) / (m.d + 1.0)
        s, t = a * scale, b * scale
        level = 1.0 / sqrt(1.0 + t * t)
        return s * level, t * level, c * level, (under > 0.0) & (c > m.cos_back)

    def derivatives(self, points: Array) -> tuple[Array, NDArray[np.bool_], Array, Array]:
        x, y, z = points.T
        d = self.d
        q = np.sqrt(x * x + z * z)
        c = z / q
        # u = fx (d + 1) x/e and v = fy (d + 1) y/e with e = d q + z.
        e = d * q + z
        k = (d + 1) / e
        pixels = np.stack([self.fx * k * x + self.cx, self.fy * k * y + self.cy], -1)
        e_x, e_z = d * x / q, d * z / q + 1
        d_point = np.zeros((len(points), 2, 3))
        for i, (f, w) in enumerate(((self.fx, x), (self.fy, y))):
            d_point[:, i, 0], d_point[:, i, 2] = -f * k * w * e_x / e, -f * k * w * e_z / e
            d_point[:, i, i] += f * k
        d_params = np.zeros((len(points), 2, 5))
        by_d = (e - (d + 1) * q) / e**2
        d_params[:, 0, 0], d_params[:, 0, 2], d_params[:, 0, 4] = k * x, 1.0, self.fx * x * by_d
        d_params[:, 1, 1], d_params[:, 1, 3], d_params[:, 1, 4] = k * y, 1.0, self.fy * y * by_d
        return pixels, (c > self.projection_values.cos_min) & (q + np.abs(y) < np.inf), d_point, d_params

    @property
    def theta_max(self) -> float:
        return float(np.arccos(self.projection_values.cos_min))

    @classmethod
    def initial_models(cls, bearings: Array, pixels: Array) -> Iterator[Self]:
        """Return linear fits of both axes for three distances of the eye."""
        x, y, z = bearings.T
        for d in (0.3, 1.0, 2.0):
            e = d * np.hypot(x, z) + z
            use = e > 0.1
            one = np.ones(use.sum())
            values = []
            for w, target in ((x, pixels[use, 0]), (y, pixels[use, 1])):
                plane = (d + 1) * w[use] / e[use]
                values.append(np.linalg.lstsq(np.stack([plane, one], -1), target, rcond=None)[0])
            (fx, cx), (fy, cy) = values
            yield cls(float(fx), float(fy), float(cx), float(cy), d)

    @classmethod
    def example(cls) -> Self:
        return cls(fx=410.0, fy=411.0, cx=639.5, cy=359.5, d=0.9)
