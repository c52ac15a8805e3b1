"""Profiles that are odd polynomials of the angle: r(theta) = theta (1 + k1 theta^2 + ...)."""

from functools import cached_property
from typing import Any

import numpy as np

from omnisight.models._elementwise import (
    any_of,
    atan2,
    elementwise,
    rounding,
    sine_cosine,
    sqrt,
    where,
    without_gradient,
)
from omnisight.models._planar_distortion import FOLD_MARGIN
from omnisight.models._polynomial_roots import first_positive_root
from omnisight.models._profile_camera import ProfileCamera, derivative_by_cosine, divide_by_sine
from omnisight.models._projector import Array

# Terms of the polynomial that approximates the inverse; three Newton steps refine it to machine precision.
START_TERMS = 7
# Largest square of the last Newton step over w of `inverse_radial_scale`, in units of `rounding`: 1e-13.
MAX_SQUARED_STEP = 450.0
COEFFICIENTS = "k1", "k2", "k3", "k4", "k5", "k6"


@elementwise
def angle_newton_step(m: Any, theta: Any, r: Any) -> Any:
    """Return theta after a Newton step towards r(theta) = r, clipped to the valid cone, and the step."""
    t2 = theta * theta
    high = m.k4 + t2 * (m.k5 + t2 * m.k6)
    high_slope = 9.0 * m.k4 + t2 * (11.0 * m.k5 + t2 * (13.0 * m.k6))
    value = theta * (1.0 + t2 * (m.k1 + t2 * (m.k2 + t2 * (m.k3 + t2 * high)))) - r
    slope = 1.0 + t2 * (3.0 * m.k1 + t2 * (5.0 * m.k2 + t2 * (7.0 * m.k3 + t2 * high_slope)))
    step = value / slope
    theta = theta - step
    theta = where(theta < m.theta_max, theta, m.theta_max)
    return where(theta > 0.0, theta, 0.0), step


class ThetaPolynomial(ProfileCamera):
    """r(theta) = theta (1 + k1 theta^2 + k2 theta^4 + ... + k6 theta^12); missing coefficients are 0.

    Inverted by Newton's method, which starts from a polynomial fitted to the inverse once per camera.
    """

    k1: float
    k2: float
    k3: float = 0.0
    k4: float = 0.0
    k5: float = 0.0
    k6: float = 0.0

    @staticmethod
    def radial_scale(m: Any, s: Any, c: Any, max_iterations: Any) -> Any:
        theta = atan2(s, c)
        t2 = theta * theta
        r = theta * (1.0 + t2 * (m.k1 + t2 * (m.k2 + t2 * (m.k3 + t2 * (m.k4 + t2 * (m.k5 + t2 * m.k6))))))
        return where(s > 1e-9, r / where(s > 1e-9, s, 1.0), 1.0)

    @staticmethod
    def inverse_radial_scale(m: Any, r: Any, r2: Any, max_iterations: Any) -> Any:
        # theta(r) behaves like a square root at the fold, so it is smooth in w.
        w = 1.0 - (r * m.inverse_fold_radius) ** 2
        w = sqrt(where(w > 0.0, w, 0.0))
        start = m.i3 + w * (m.i4 + w * (m.i5 + w * m.i6))
        theta = r * (m.i0 + w * (m.i1 + w * (m.i2 + w * start)))
        theta = where(theta < m.theta_max, theta, m.theta_max)
        # The error is the square of the last step over w, which vanishes at the fold. Beyond the rim no angle exists.
        largest = MAX_SQUARED_STEP * rounding(r) * w
        # Unrolled: the compiled loop over the points then vectorizes.
        theta, step = angle_newton_step(m, theta, r)
        if max_iterations is not None:
            for _ in range(max_iterations):
                theta, step = angle_newton_step(m, theta, r)
                if not any_of((step * step >= largest) & (r <= m.r_last)):
                    break
        theta, step = angle_newton_step(m, without_gradient(theta), r)
        theta, step = angle_newton_step(m, theta, r)
        s, c = sine_cosine(theta)
        converged = (step * step < largest) | (r > m.r_last)
        return where(converged, where(r > 1e-9, s / where(r > 1e-9, r, 1.0), 1.0), np.inf), c

    def projection_constants(self) -> dict[str, Any]:
        return super().projection_constants() | {k: 0.0 for k in COEFFICIENTS if k not in self.param_names}

    def unprojection_constants(self) -> dict[str, Any]:
        limit = self.fold
        theta = limit * np.sin(np.linspace(0, np.pi / 2, 65)[1:])  # denser towards the fold
        r = theta * self._polynomial(theta)
        w = np.sqrt(np.maximum(1 - (r / r[-1]) ** 2, 0))
        start = np.linalg.lstsq(w[:, None] ** np.arange(START_TERMS), theta / r, rcond=None)[0]
        terms = {f"i{i}": float(value) for i, value in enumerate(start)}
        # Slightly larger than the last angle, because the edge itself is valid.
        inverse = {
            "inverse_fold_radius": 1 / float(r[-1]),
            "theta_max": self.theta_max * (1 + 1e-12),
            "r_last": self.radius_max(),
        }
        return super().unprojection_constants() | terms | inverse

    def _polynomial(self, theta: Any) -> Any:
        return np.polynomial.polynomial.polyval(theta**2, [1.0, self.k1, self.k2, self.k3, self.k4, self.k5, self.k6])

    @cached_property
    def fold(self) -> float:
        """The angle (radians) where r(theta) stops increasing, at most 180 degrees."""
        return float(min(np.pi, first_positive_root(self.slope_polynomial()) ** 0.5))

    def slope_polynomial(self) -> list[float]:
        k = (self.k1, self.k2, self.k3, self.k4, self.k5, self.k6)
        return [1.0] + [(2 * i + 3) * value for i, value in enumerate(k)]

    def slope_angle(self, x: float) -> float:
        return x**0.5

    @property
    def theta_max(self) -> float:
        return self.fold if self.fold == np.pi else self.fold * (1 - FOLD_MARGIN)

    def radius_max(self) -> float:
        limit = self.theta_max
        return float(limit * self._polynomial(np.float64(limit)))

    def radial_scale_derivatives(self, s: Array, c: Array, g: Array) -> tuple[Array, dict[str, Array]]:
        theta = atan2(s, c)
        slope = np.polynomial.polynomial.polyval(theta**2, self.slope_polynomial())
        dg_dc = derivative_by_cosine(s, c, g, slope, at_axis=-2 * (self.k1 + 1 / 6))
        t2, power = theta * theta, divide_by_sine(theta, s, c, at_axis=1.0)
        return dg_dc, {name: (power := power * t2) for name in COEFFICIENTS if name in self.param_names}
