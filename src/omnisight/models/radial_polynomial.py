"""The fisheye whose radius is a polynomial of all powers of the angle."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from omnisight.models._central import Central, per_sine
from omnisight.models._elementwise import angle_step, atan2, settled, sine_cosine, where
from omnisight.models._parameter import parameter
from omnisight.models._planar import FOLD_MARGIN, first_positive_root
from omnisight.models._projector import Array

# What magnifies so much more off the axis than on it is no lens: f would run to 0 and the others after it.
STEEPEST = 4.0


@dataclass(frozen=True)
class RadialPolynomial(Central):
    """Polynomial of the angle, even powers too: r = theta (1 + k2 theta + k3 theta^2 + k4 theta^3).

    WoodScape's radial_poly, whose k1 is our fx and whose k2 ... k4 are fx times ours; Hugin's fisheye with a, b, c.
    The even powers bend r at the axis, as no lens does, and make room for a better rim. Valid up to the angle where r
    stops growing, 180 degrees at most. Yogamani et al., WoodScape: a multi-task, multi-camera fisheye dataset for
    autonomous driving, ICCV 2019.
    """

    auto_max_theta: ClassVar[float] = 0.0

    SHAPES: ClassVar = tuple({"k2": k2, "k3": k3, "k4": 0.0} for k2, k3 in ((0.0, 0.0), (-0.1, 0.05), (0.05, -0.05)))

    fx: float = parameter("focal length along x", unit="px")
    fy: float = parameter("focal length along y", unit="px")
    cx: float = parameter("principal point", unit="px")
    cy: float = parameter("principal point", unit="px")
    k2: float = parameter("coefficient of theta^2", low=-STEEPEST, high=STEEPEST)
    k3: float = parameter("coefficient of theta^3", low=-STEEPEST, high=STEEPEST)
    k4: float = parameter("coefficient of theta^4", low=-STEEPEST, high=STEEPEST)

    @staticmethod
    def gain(m: Any, s: Any, c: Any, effort: Any) -> Any:
        theta = atan2(s, c)
        r = theta * (1.0 + theta * (m.k2 + theta * (m.k3 + theta * m.k4)))
        return where(s > 1e-9, r / where(s > 1e-9, s, 1.0), 1.0)

    @staticmethod
    def ungain(m: Any, r: Any, r2: Any, effort: Any) -> Any:
        # theta(r) has a square root at the fold, and so is smooth in w; the even powers make it smooth in q as well.
        q = r * m.over_fold
        w = 1.0 - q * q
        w = np.sqrt(where(w > 0.0, w, 0.0))
        theta = r * (m.i0 + w * (m.i1 + w * (m.i2 + w * m.i3)) + q * (m.i4 + w * (m.i5 + w * m.i6)))
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
        value = theta * (1.0 + theta * (m.k2 + theta * (m.k3 + theta * m.k4))) - r
        slope = 1.0 + theta * (2.0 * m.k2 + theta * (3.0 * m.k3 + theta * 4.0 * m.k4))
        step = value / slope
        theta = theta - step
        theta = where(theta < m.theta_max, theta, m.theta_max)
        return where(theta > 0.0, theta, 0.0), step

    def derived_back(self) -> dict[str, Any]:
        theta = self.fold * np.sin(np.linspace(0, np.pi / 2, 65)[1:])  # denser towards the fold
        r = self._radius(theta)
        q = r / r[-1]
        w = np.sqrt(np.maximum(1 - q * q, 0))
        powers = [w**i for i in range(4)] + [q * w**i for i in range(3)]
        start = np.linalg.lstsq(np.stack(powers, -1), theta / r, rcond=None)[0]
        # A hair past the last angle keeps the rim itself.
        inverse = {
            "over_fold": 1 / float(r[-1]),
            "theta_max": self.theta_max * (1 + 1e-12),
            "r_last": self.radius_max(),
        }
        return super().derived_back() | {f"i{i}": float(value) for i, value in enumerate(start)} | inverse

    def _radius(self, theta: Any) -> Any:
        return np.polynomial.polynomial.polyval(theta, [0.0, 1.0, self.k2, self.k3, self.k4])

    @cached_property
    def fold(self) -> float:
        """The angle (radians) where r(theta) stops growing, 180 degrees at most."""
        return float(min(np.pi, first_positive_root(self.growth())))

    def growth(self) -> list[float]:
        return [1.0, 2 * self.k2, 3 * self.k3, 4 * self.k4]

    def growth_angle(self, x: float) -> float:
        return x

    @property
    def theta_max(self) -> float:
        return self.fold if self.fold == np.pi else self.fold * (1 - FOLD_MARGIN)

    def radius_max(self) -> float:
        return float(self._radius(np.float64(self.theta_max)))

    def gain_derivatives(self, s: Array, c: Array, g: Array) -> tuple[Array, dict[str, Array]]:
        theta = atan2(s, c)
        slope = np.polynomial.polynomial.polyval(theta, self.growth())
        # It grows as k2/theta towards the axis, where it meets factors that vanish: no limit is needed there.
        near = (s < 1e-9) & (c > 0)
        dg_dc = np.where(near, 0.0, -(slope - g * c) / np.where(near, 1.0, s * s))
        return dg_dc, {f"k{i}": per_sine(theta**i, s, c) for i in (2, 3, 4)}

    @classmethod
    def example(cls) -> Self:
        return cls(fx=340.0, fy=341.0, cx=479.5, cy=481.0, k2=-0.094, k3=0.142, k4=-0.0212)
