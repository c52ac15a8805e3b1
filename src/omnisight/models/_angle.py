"""Profiles written in the angle itself: r(theta) = theta (1 + k1 theta^2 + ...)."""

from functools import cached_property
from typing import Any

import numpy as np

from omnisight.models._central import Central, along_the_sphere, per_sine
from omnisight.models._elementwise import angle_step, atan2, settled, sine_cosine, where
from omnisight.models._planar import FOLD_MARGIN, first_positive_root
from omnisight.models._projector import Array

START_TERMS = 7
COEFFICIENTS = "k1", "k2", "k3", "k4", "k5", "k6"


class AnglePolynomial(Central):
    """r(theta) = theta (1 + k1 theta^2 + k2 theta^4 + ... + k6 theta^12); coefficients that a model lacks are 0.

    Inverted by Newton's method from a polynomial in r that is fitted to the profile once per camera.
    """

    k1: float
    k2: float
    k3: float = 0.0
    k4: float = 0.0
    k5: float = 0.0
    k6: float = 0.0

    @staticmethod
    def gain(m: Any, s: Any, c: Any, effort: Any) -> Any:
        theta = atan2(s, c)
        t2 = theta * theta
        r = theta * (1.0 + t2 * (m.k1 + t2 * (m.k2 + t2 * (m.k3 + t2 * (m.k4 + t2 * (m.k5 + t2 * m.k6))))))
        return where(s > 1e-9, r / where(s > 1e-9, s, 1.0), 1.0)

    @staticmethod
    def ungain(m: Any, r: Any, r2: Any, effort: Any) -> Any:
        # theta(r) has a square root at the fold, and so is smooth in w.
        w = 1.0 - (r * m.over_fold) ** 2
        w = np.sqrt(where(w > 0.0, w, 0.0))
        start = m.i3 + w * (m.i4 + w * (m.i5 + w * m.i6))
        theta = r * (m.i0 + w * (m.i1 + w * (m.i2 + w * start)))
        theta = where(theta < m.theta_max, theta, m.theta_max)
        # Written out, not in a loop: so the compiled loop over the points vectorises.
        theta, step = angle_step(m, theta, r)
        theta, step = angle_step(m, theta, r)
        theta, step = angle_step(m, theta, r)
        if effort is not None:
            for _ in range(effort):
                theta, step = angle_step(m, theta, r)
                if settled(step, 1e-15):
                    break
        s, c = sine_cosine(theta)
        # A last step leaves its square over w, which vanishes at the fold; past the rim there is nothing to find.
        found = (step * step < 1e-13 * w) | (r > m.r_last)
        return where(found, where(r > 1e-9, s / where(r > 1e-9, r, 1.0), 1.0), np.inf), c

    @staticmethod
    def angle_step(m: Any, theta: Any, r: Any) -> Any:
        """Give theta after a Newton step towards r(theta) = r, kept within the valid cone, and the step."""
        t2 = theta * theta
        high = m.k4 + t2 * (m.k5 + t2 * m.k6)
        high_slope = 9.0 * m.k4 + t2 * (11.0 * m.k5 + t2 * (13.0 * m.k6))
        value = theta * (1.0 + t2 * (m.k1 + t2 * (m.k2 + t2 * (m.k3 + t2 * high)))) - r
        slope = 1.0 + t2 * (3.0 * m.k1 + t2 * (5.0 * m.k2 + t2 * (7.0 * m.k3 + t2 * high_slope)))
        step = value / slope
        theta = theta - step
        theta = where(theta < m.theta_max, theta, m.theta_max)
        return where(theta > 0.0, theta, 0.0), step

    def derived(self) -> dict[str, Any]:
        return super().derived() | {k: 0.0 for k in COEFFICIENTS if k not in self.param_names}

    def derived_back(self) -> dict[str, Any]:
        limit = self.fold
        theta = limit * np.sin(np.linspace(0, np.pi / 2, 65)[1:])  # denser towards the fold
        r = theta * self._polynomial(theta)
        w = np.sqrt(np.maximum(1 - (r / r[-1]) ** 2, 0))
        start = np.linalg.lstsq(w[:, None] ** np.arange(START_TERMS), theta / r, rcond=None)[0]
        terms = {f"i{i}": float(value) for i, value in enumerate(start)}
        # A hair past the last angle keeps the rim itself.
        inverse = {
            "over_fold": 1 / float(r[-1]),
            "theta_max": self.theta_max * (1 + 1e-12),
            "r_last": self.radius_max(),
        }
        return super().derived_back() | terms | inverse

    def _polynomial(self, theta: Any) -> Any:
        return np.polynomial.polynomial.polyval(theta**2, [1.0, self.k1, self.k2, self.k3, self.k4, self.k5, self.k6])

    @cached_property
    def fold(self) -> float:
        """The angle (radians) where r(theta) stops growing, 180 degrees at most."""
        return float(min(np.pi, first_positive_root(self.growth()) ** 0.5))

    def growth(self) -> list[float]:
        k = (self.k1, self.k2, self.k3, self.k4, self.k5, self.k6)
        return [1.0] + [(2 * i + 3) * value for i, value in enumerate(k)]

    def growth_angle(self, x: float) -> float:
        return x**0.5

    @property
    def theta_max(self) -> float:
        return self.fold if self.fold == np.pi else self.fold * (1 - FOLD_MARGIN)

    def radius_max(self) -> float:
        limit = self.theta_max
        return float(limit * self._polynomial(np.float64(limit)))

    def gain_derivatives(self, s: Array, c: Array, g: Array) -> tuple[Array, dict[str, Array]]:
        theta = atan2(s, c)
        slope = np.polynomial.polynomial.polyval(theta**2, self.growth())
        dg_dc = along_the_sphere(s, c, g, slope, at_axis=-2 * (self.k1 + 1 / 6))
        t2, power = theta * theta, per_sine(theta, s, c, at_axis=1.0)
        return dg_dc, {name: (power := power * t2) for name in COEFFICIENTS if name in self.param_names}
