"""The Cassini panorama: an equirectangular image whose poles lie on the x axis."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from omnisight.models._camera_model import CameraModel
from omnisight.models._elementwise import absolute, clipped, signed_atan2, signed_sine_cosine, sqrt
from omnisight.models._parameter import parameter
from omnisight.models._projector import Array


@dataclass(frozen=True)
class Cassini(CameraModel):
    """The transverse equirectangular map: u = fx atan(x/hypot(y, z)) + cx, v = fy atan2(y, z) + cy.

    Forward (z) is in the middle, right is to the right, down is below; straight left and right are the left and the
    right edge. A row is half a great circle through both: if x is the baseline of two cameras, rows are epipolar curves
    (S. Li, Binocular spherical stereo, IEEE Trans. Intelligent Transportation Systems 9(4), 2008). Valid everywhere.
    """

    auto_max_theta: ClassVar[float] = 0.0

    fx: float = parameter("pixels per radian along a row", unit="px")
    fy: float = parameter("pixels per radian about the x axis", unit="px")
    cx: float = parameter("column of the directions perpendicular to the x axis", unit="px")
    cy: float = parameter("row of the half-plane of x and z", unit="px")

    @staticmethod
    def project_point(m: Any, x: Any, y: Any, z: Any, max_iterations: Any) -> Any:
        q = sqrt(y * y + z * z)
        length = q + absolute(x)
        latitude, longitude = signed_atan2(x, q), signed_atan2(y, z)
        return m.fx * latitude + m.cx, m.fy * longitude + m.cy, (length > 0.0) & (length < np.inf)

    @staticmethod
    def unproject_pixel(m: Any, u: Any, v: Any, max_iterations: Any) -> Any:
        latitude, longitude = (u - m.cx) / m.fx, (v - m.cy) / m.fy
        # Half a pixel beyond 180 degrees lies on the other side of the seam.
        inside = absolute(latitude) <= 1.5707963267948966 * (1.0 + 1e-12)
        valid = inside & (absolute(longitude) <= 3.141592653589793 * (1.0 + 1e-12))
        s, c = signed_sine_cosine(clipped(latitude, 1.5707963267948966))
        down, ahead = signed_sine_cosine(clipped(longitude, 3.141592653589793))
        return s, down * c, ahead * c, valid

    def derivatives(self, points: Array) -> tuple[Array, NDArray[np.bool_], Array, Array]:
        x, y, z = points.T
        q2 = y * y + z * z
        q, r2 = np.sqrt(q2), x * x + q2
        latitude, longitude = np.arctan2(x, q), np.arctan2(y, z)
        pixels = np.stack([self.fx * latitude + self.cx, self.fy * longitude + self.cy], -1)
        valid = (r2 > 0) & (q + np.abs(x) < np.inf)
        d_point = np.zeros((len(points), 2, 3))
        along = -self.fx * x / (q * r2)
        d_point[:, 0, 0], d_point[:, 0, 1], d_point[:, 0, 2] = self.fx * q / r2, along * y, along * z
        d_point[:, 1, 1], d_point[:, 1, 2] = self.fy * z / q2, -self.fy * y / q2
        d_params = np.zeros((len(points), 2, 4))
        d_params[:, 0, 0], d_params[:, 0, 2] = latitude, 1.0
        d_params[:, 1, 1], d_params[:, 1, 3] = longitude, 1.0
        return pixels, valid, d_point, d_params

    @classmethod
    def initial_models(cls, bearings: Array, pixels: Array) -> Iterator[Self]:
        """Return a linear fit of both axes to the directions far from the seam."""
        x, y, z = bearings.T
        longitude = np.arctan2(y, z)
        use = np.abs(longitude) < 3.0
        one = np.ones(use.sum())
        latitude = np.arctan2(x, np.hypot(y, z))[use]
        fx, cx = np.linalg.lstsq(np.stack([latitude, one], -1), pixels[use, 0], rcond=None)[0]
        fy, cy = np.linalg.lstsq(np.stack([longitude[use], one], -1), pixels[use, 1], rcond=None)[0]
        yield cls(float(fx), float(fy), float(cx), float(cy))

    @classmethod
    def example(cls) -> Self:
        return cls(fx=512 / np.pi, fy=512 / np.pi, cx=255.5, cy=511.5)
