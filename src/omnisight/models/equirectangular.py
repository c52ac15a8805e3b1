"""The equirectangular 360 image."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from omnisight.models._cylindrical_projection import CylindricalProjection
from omnisight.models._elementwise import absolute, clipped, signed_atan2, signed_sine_cosine, where
from omnisight.models._projector import Array


@dataclass(frozen=True)
class Equirectangular(CylindricalProjection):
    """Longitude and latitude as they are: u = fx atan2(x, z) + cx, v = fy atan(y/hypot(x, z)) + cy.

    Forward (z) is in the middle, right is to the right, down is below. An image W x H of the whole sphere has
    fx = W/(2 pi), fy = H/pi, cx = (W - 1)/2, cy = (H - 1)/2: column W would be column 0. Valid everywhere.
    """

    auto_max_theta: ClassVar[float] = 0.0

    @staticmethod
    def cylinder_height(m: Any, y: Any, q: Any) -> Any:
        return where(absolute(y) + q > 0.0, signed_atan2(y, q), np.nan)

    @staticmethod
    def inverse_cylinder_height(m: Any, h: Any) -> Any:
        s, c = signed_sine_cosine(clipped(h, 1.5707963267948966))
        return c, s, absolute(h) <= 1.5707963267948966 * (1.0 + 1e-12)

    @staticmethod
    def cylinder_height_derivative(t: Array) -> Array:
        return 1 / (1 + t * t)
