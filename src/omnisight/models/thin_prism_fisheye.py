"""The equidistant fisheye with radial, tangential and thin-prism distortion of its plane, eight coefficients."""

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from omnisight.models._parameter import parameter
from omnisight.models._planar_distortion import RadialDistortion, tangential_partials
from omnisight.models._projector import Array, Partial
from omnisight.models.equidistant import EquidistantProfile


class ThinPrismDistortion(RadialDistortion):
    """x' = x (1 + k1 r^2 + ... + k4 r^8) + 2 p1 x y + p2 (r^2 + 2 x^2) + s1 r^2, and alike in y with s2."""

    k1: float
    k2: float
    k3: float
    k4: float

    @staticmethod
    def distort(m: Any, x: Any, y: Any) -> Any:
        r2 = x * x + y * y
        radial = 1.0 + r2 * (m.k1 + r2 * (m.k2 + r2 * (m.k3 + r2 * m.k4)))
        dx = 2.0 * m.p1 * x * y + m.p2 * (r2 + 2.0 * x * x) + m.s1 * r2
        dy = m.p1 * (r2 + 2.0 * y * y) + 2.0 * m.p2 * x * y + m.s2 * r2
        return x * radial + dx, y * radial + dy

    @staticmethod
    def distort_jacobian(m: Any, x: Any, y: Any) -> Any:
        r2 = x * x + y * y
        radial = 1.0 + r2 * (m.k1 + r2 * (m.k2 + r2 * (m.k3 + r2 * m.k4)))
        slope = 2.0 * (m.k1 + r2 * (2.0 * m.k2 + r2 * (3.0 * m.k3 + r2 * 4.0 * m.k4)))
        cross = x * y * slope + 2.0 * (m.p1 * x + m.p2 * y)
        xx = radial + x * x * slope + 2.0 * m.p1 * y + 6.0 * m.p2 * x + 2.0 * m.s1 * x
        yy = radial + y * y * slope + 6.0 * m.p1 * y + 2.0 * m.p2 * x + 2.0 * m.s2 * y
        return xx, cross + 2.0 * m.s1 * y, cross + 2.0 * m.s2 * x, yy

    def distort_partials(self, x: Array, y: Array) -> dict[str, tuple[Partial, Partial]]:
        r2 = x * x + y * y
        radial = {f"k{i}": (x * r2**i, y * r2**i) for i in (1, 2, 3, 4)}
        return radial | tangential_partials(x, y) | {"s1": (r2, 0.0), "s2": (0.0, r2)}

    def slope_polynomial(self) -> list[float]:
        return [1.0, 3 * self.k1, 5 * self.k2, 7 * self.k3, 9 * self.k4]


@dataclass(frozen=True)
class ThinPrismFisheye(ThinPrismDistortion, EquidistantProfile):
    """Equidistant fisheye, then eight coefficients on its plane: COLMAP's THIN_PRISM_FISHEYE.

    With (x, y) = theta (cos phi, sin phi) and r = theta:
    x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8) + 2 p1 x y + p2 (r^2 + 2 x^2) + s1 r^2
    y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8) + p1 (r^2 + 2 y^2) + 2 p2 x y + s2 r^2

    Valid while the planar distortion is injective, below 180 degrees. As COLMAP writes Weng, Cohen and Herniou's
    distortion (Camera calibration with distortion models and accuracy evaluation, PAMI 1992) for fisheyes.

    A calibration estimates s1 and s2 only on request: to second order in theta, a small rotation of the camera frame
    moves the principal point and adds multiples of (p1, p2) and (s1, s2) in the ratio 1 to -3. With both pairs free the
    frame is hardly determined; with s = 0 it is, and only higher orders of a decentered lens are lost.
    """

    auto_max_theta: ClassVar[float] = np.radians(125.0)  # the widest common fisheyes; mirrors see farther

    fx: float = parameter("focal length along x", unit="px")
    fy: float = parameter("focal length along y", unit="px")
    cx: float = parameter("principal point", unit="px")
    cy: float = parameter("principal point", unit="px")
    k1: float = parameter("coefficient of theta^3", prior_sigma=2.0, truncated_start=True)
    k2: float = parameter("coefficient of theta^5", prior_sigma=2.0, truncated_start=True)
    p1: float = parameter("tangential distortion", prior_sigma=0.02, start_zero=True)
    p2: float = parameter("tangential distortion", prior_sigma=0.02, start_zero=True)
    k3: float = parameter("coefficient of theta^7", prior_sigma=2.0, truncated_start=True)
    k4: float = parameter("coefficient of theta^9", prior_sigma=2.0, truncated_start=True)
    s1: float = parameter("thin-prism distortion in x", prior_sigma=0.02, start_zero=True, free=False)
    s2: float = parameter("thin-prism distortion in y", prior_sigma=0.02, start_zero=True, free=False)

    @classmethod
    def example(cls) -> Self:
        return cls(
            fx=281.0,
            fy=280.0,
            cx=479.5,
            cy=481.0,
            k1=0.03,
            k2=-0.011,
            p1=3e-4,
            p2=-5e-4,
            k3=0.0021,
            k4=-0.00019,
            s1=4e-4,
            s2=-2e-4,
        )
