"""The fisheye whose radius is a polynomial of all powers of the angle."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

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
from omnisight.models._parameter import parameter
from omnisight.models._planar_distortion import FOLD_MARGIN
from omnisight.models._polynomial_roots import first_positive_root
from omnisight.models._profile_camera import ProfileCamera, divide_by_sine
from omnisight.models._projector import Array
from omnisight.models._theta_polynomial import MAX_SQUARED_STEP

# Bound of the coefficients: without it a fit lets the focal length approach 0 and these grow.
MAX_COEFFICIENT = 4.0


@elementwise
def angle_newton_step(m: Any, theta: Any, r: Any) -> Any:
    """Return theta after a Newton step towards r(theta) = r, clipped to the valid cone, and the step."""
    value = theta * (1.0 + theta * (m.k2 + theta * (m.k3 + theta * m.k4))) - r
    slope = 1.0 + theta * (2.0 * m.k2 + theta * (3.0 * m.k3 + theta * 4.0 * m.k4))
    step = value / slope
    theta = theta - step
    theta = where(theta < m.theta_max, theta, m.theta_max)
    return where(theta > 0.0, theta, 0.0), step


@dataclass(frozen=True)
class RadialPolynomial(ProfileCamera):
    """Polynomial of the angle, even powers too: r = theta (1 + k2 theta + k3 theta^2 + k4 theta^3).

    WoodScape's radial_poly, whose k1 is our fx and whose k2 ... k4 are fx times ours; Hugin's fisheye with a, b, c.
    The even powers bend r at the axis, as no lens does, and make room for a better rim. Valid up to the angle where r
    stops increasing, at most 180 degrees. Yogamani et al., WoodScape: a multi-task, multi-camera fisheye dataset for
    autonomous driving, ICCV 2019.
    """

    auto_max_theta: ClassVar[float] = 0.0

    INITIAL_SHAPES: ClassVar = tuple(
        {"k2": k2, "k3": k3, "k4": 0.0} for k2, k3 in ((0.0, 0.0), (-0.1, 0.05), (0.05, -0.05))
    )

    fx: float = parameter("focal length along x", unit="px")
    fy: float = parameter("focal length along y", unit="px")
    cx: float = parameter("principal point", unit="px")
    cy: float = parameter("principal point", unit="px")
    k2: float = parameter("coefficient of theta^2", low=-MAX_COEFFICIENT, high=MAX_COEFFICIENT)
    k3: float = parameter("coefficient of theta^3", low=-MAX_COEFFICIENT, high=MAX_COEFFICIENT)
    k4: float = parameter("coefficient of theta^4", low=-MAX_COEFFICIENT, high=MAX_COEFFICIENT)

    @staticmethod
    def radial_scale(m: Any, s: Any, c: Any, max_iterations: Any) -> Any:
        theta = atan2(s, c)
        r = theta * (1.0 + theta * (m.k2 + theta * (m.k3 + theta * m.k4)))
        return where(s > 1e-9, r / where(s > 1e-9, s, 1.0), 1.0)

    @staticmethod
    def inverse_radial_scale(m: Any, r: Any, r2: Any, max_iterations: Any) -> Any:
        # theta(r) behaves like a square root at the fold, so it is smooth in w; the even powers also need q.
        q = r * m.inverse_fold_radius
        w = 1.0 - q * q
        w = sqrt(where(w > 0.0, w, 0.0))
        theta = r * (m.i0 + w * (m.i1 + w * (m.i2 + w * m.i3)) + q * (m.i4 + w * (m.i5 + w * m.i6)))
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

    def unprojection_constants(self) -> dict[str, Any]:
        theta = self.fold * np.sin(np.linspace(0, np.pi / 2, 65)[1:])  # denser towards the fold
        r = self._radius(theta)
        q = r / r[-1]
        w = np.sqrt(np.maximum(1 - q * q, 0))
        powers = [w**i for i in range(4)] + [q * w**i for i in range(3)]
        start = np.linalg.lstsq(np.stack(powers, -1), theta / r, rcond=None)[0]
        # Slightly larger than the last angle, because the edge itself is valid.
        inverse = {
            "inverse_fold_radius": 1 / float(r[-1]),
            "theta_max": self.theta_max * (1 + 1e-12),
            "r_last": self.radius_max(),
        }
        return super().unprojection_constants() | {f"i{i}": float(value) for i, value in enumerate(start)} | inverse

    def _radius(self, theta: Any) -> Any:
        return np.polynomial.polynomial.polyval(theta, [0.0, 1.0, self.k2, self.k3, self.k4])

    @cached_property
    def fold(self) -> float:
        """The angle (radians) where r(theta) stops increasing, at most 180 degrees."""
        return float(min(np.pi, first_positive_root(self.slope_polynomial())))

    def slope_polynomial(self) -> list[float]:
        return [1.0, 2 * self.k2, 3 * self.k3, 4 * self.k4]

    def slope_angle(self, x: float) -> float:
        return x

    @property
    def theta_max(self) -> float:
        return self.fold if self.fold == np.pi else self.fold * (1 - FOLD_MARGIN)

    def radius_max(self) -> float:
        return float(self._radius(np.float64(self.theta_max)))

    def radial_scale_derivatives(self, s: Array, c: Array, g: Array) -> tuple[Array, dict[str, Array]]:
        theta = atan2(s, c)
        slope = np.polynomial.polynomial.polyval(theta, self.slope_polynomial())
        # It grows like k2/theta towards the axis, but is multiplied by factors that vanish there.
        near = (s < 1e-9) & (c > 0)
        dg_dc = np.where(near, 0.0, -(slope - g * c) / np.where(near, 1.0, s * s))
        return dg_dc, {f"k{i}": divide_by_sine(theta**i, s, c) for i in (2, 3, 4)}

    @classmethod
    def example(cls) -> Self:
        return cls(fx=340.0, fy=341.0, cx=479.5, cy=481.0, k2=-0.094, k3=0.142, k4=-0.0212)
