"""Profiles that are odd polynomials of the angle: r(theta) = theta (1 + k1 theta^2 + ...)."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from omnisight.models._angle_polynomial import AnglePolynomial
from omnisight.models._elementwise import atan2
from omnisight.models._profile_camera import derivative_by_cosine, divide_by_sine
from omnisight.models._projector import Array

COEFFICIENTS = "k1", "k2", "k3", "k4", "k5", "k6"


class ThetaPolynomial(AnglePolynomial):
    """r(theta) = theta (1 + k1 theta^2 + k2 theta^4 + ... + k6 theta^12); missing coefficients are 0."""

    k1: float
    k2: float
    k3: float = 0.0
    k4: float = 0.0
    k5: float = 0.0
    k6: float = 0.0

    @staticmethod
    def radius_and_slope(m: Any, theta: Any) -> Any:
        t2 = theta * theta
        high = m.k4 + t2 * (m.k5 + t2 * m.k6)
        high_slope = 9.0 * m.k4 + t2 * (11.0 * m.k5 + t2 * (13.0 * m.k6))
        r = theta * (1.0 + t2 * (m.k1 + t2 * (m.k2 + t2 * (m.k3 + t2 * high))))
        slope = 1.0 + t2 * (3.0 * m.k1 + t2 * (5.0 * m.k2 + t2 * (7.0 * m.k3 + t2 * high_slope)))
        return r, slope

    @staticmethod
    def initial_angle(m: Any, r: Any, q: Any, w: Any) -> Any:
        high = m.i3 + w * (m.i4 + w * (m.i5 + w * m.i6))
        return r * (m.i0 + w * (m.i1 + w * (m.i2 + w * high)))

    @staticmethod
    def start_terms(q: Array, w: Array) -> Sequence[Array]:
        return [w**i for i in range(7)]

    def projection_constants(self) -> dict[str, Any]:
        return super().projection_constants() | {k: 0.0 for k in COEFFICIENTS if k not in self.param_names}

    def slope_polynomial(self) -> list[float]:
        k = (self.k1, self.k2, self.k3, self.k4, self.k5, self.k6)
        return [1.0] + [(2 * i + 3) * value for i, value in enumerate(k)]

    def slope_angle(self, x: float) -> float:
        return x**0.5

    def radial_scale_derivatives(self, s: Array, c: Array, g: Array) -> tuple[Array, dict[str, Array]]:
        theta = atan2(s, c)
        slope = np.polynomial.polynomial.polyval(theta**2, self.slope_polynomial())
        dg_dc = derivative_by_cosine(s, c, g, slope, at_axis=-2 * (self.k1 + 1 / 6))
        t2, power = theta * theta, divide_by_sine(theta, s, c, at_axis=1.0)
        return dg_dc, {name: (power := power * t2) for name in COEFFICIENTS if name in self.param_names}
