"""The fisheye whose radius is a polynomial of all powers of the angle."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from omnisight.models._angle_polynomial import AnglePolynomial
from omnisight.models._elementwise import atan2
from omnisight.models._parameter import parameter
from omnisight.models._profile_camera import divide_by_sine
from omnisight.models._projector import Array

# Bound of the coefficients: without it a fit lets the focal length approach 0 and these grow.
MAX_COEFFICIENT = 4.0


@dataclass(frozen=True)
class RadialPolynomial(AnglePolynomial):
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
    def radius_and_slope(m: Any, theta: Any) -> Any:
        r = theta * (1.0 + theta * (m.k2 + theta * (m.k3 + theta * m.k4)))
        slope = 1.0 + theta * (2.0 * m.k2 + theta * (3.0 * m.k3 + theta * 4.0 * m.k4))
        return r, slope

    @staticmethod
    def initial_angle(m: Any, r: Any, q: Any, w: Any) -> Any:
        return r * (m.i0 + w * (m.i1 + w * (m.i2 + w * m.i3)) + q * (m.i4 + w * (m.i5 + w * m.i6)))

    @staticmethod
    def start_terms(q: Array, w: Array) -> Sequence[Array]:
        return [*(w**i for i in range(4)), *(q * w**i for i in range(3))]  # the even powers also need q

    def slope_polynomial(self) -> list[float]:
        return [1.0, 2 * self.k2, 3 * self.k3, 4 * self.k4]

    def slope_angle(self, x: float) -> float:
        return x

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
