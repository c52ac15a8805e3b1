"""The fisheye with six radial, two tangential and four thin-prism coefficients."""

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from omnisight.models._parameter import parameter
from omnisight.models._planar_distortion import PlanarDistortion, tangential_partials
from omnisight.models._projector import Array, Partial
from omnisight.models._theta_polynomial import ThetaPolynomial


class TangentialPrismDistortion(PlanarDistortion):
    """x' = x + 2 p2 x y + p1 (r^2 + 2 x^2) + s1 r^2 + s2 r^4, and alike in y with p2, p1, s3, s4."""

    p1: float
    p2: float
    s1: float
    s2: float
    s3: float
    s4: float

    @staticmethod
    def distort(m: Any, x: Any, y: Any) -> Any:
        r2 = x * x + y * y
        dx = 2.0 * m.p2 * x * y + m.p1 * (r2 + 2.0 * x * x) + r2 * (m.s1 + r2 * m.s2)
        dy = m.p2 * (r2 + 2.0 * y * y) + 2.0 * m.p1 * x * y + r2 * (m.s3 + r2 * m.s4)
        return x + dx, y + dy

    @staticmethod
    def distort_jacobian(m: Any, x: Any, y: Any) -> Any:
        r2 = x * x + y * y
        along_x = 2.0 * (m.s1 + 2.0 * r2 * m.s2)
        along_y = 2.0 * (m.s3 + 2.0 * r2 * m.s4)
        cross = 2.0 * (m.p2 * x + m.p1 * y)
        xx = 1.0 + 2.0 * m.p2 * y + 6.0 * m.p1 * x + along_x * x
        yy = 1.0 + 6.0 * m.p2 * y + 2.0 * m.p1 * x + along_y * y
        return xx, cross + along_x * y, cross + along_y * x, yy

    def distort_partials(self, x: Array, y: Array) -> dict[str, tuple[Partial, Partial]]:
        r2 = x * x + y * y
        by = tangential_partials(x, y)
        return {
            "p1": by["p2"],
            "p2": by["p1"],
            "s1": (r2, 0.0),
            "s2": (r2**2, 0.0),
            "s3": (0.0, r2),
            "s4": (0.0, r2**2),
        }


@dataclass(frozen=True)
class Fisheye624(TangentialPrismDistortion, ThetaPolynomial):
    """Fisheye with 6 radial, 2 tangential and 4 thin-prism coefficients: Project Aria's Fisheye624.

    COLMAP's RAD_TAN_THIN_PRISM_FISHEYE with its k0 ... k5 as k1 ... k6, p0, p1 as p1, p2 and s0 ... s3 as s1 ... s4.

    r = theta (1 + k1 theta^2 + ... + k6 theta^12), then on the plane (x, y) = r (cos phi, sin phi):
    x' = x + 2 p2 x y + p1 (r^2 + 2 x^2) + s1 r^2 + s2 r^4
    y' = y + p2 (r^2 + 2 y^2) + 2 p1 x y + s3 r^2 + s4 r^4

    Valid while r increases and the planar distortion is injective.
    """

    auto_max_theta: ClassVar[float] = 0.0

    fx: float = parameter("focal length along x", unit="px")
    fy: float = parameter("focal length along y", unit="px")
    cx: float = parameter("principal point", unit="px")
    cy: float = parameter("principal point", unit="px")
    k1: float = parameter("coefficient of theta^3", prior_sigma=2.0, truncated_start=True)
    k2: float = parameter("coefficient of theta^5", prior_sigma=2.0, truncated_start=True)
    k3: float = parameter("coefficient of theta^7", prior_sigma=2.0, truncated_start=True)
    k4: float = parameter("coefficient of theta^9", prior_sigma=2.0, truncated_start=True)
    k5: float = parameter("coefficient of theta^11", prior_sigma=2.0, truncated_start=True)
    k6: float = parameter("coefficient of theta^13", prior_sigma=2.0, truncated_start=True)
    p1: float = parameter("tangential distortion", prior_sigma=0.02, start_zero=True)
    p2: float = parameter("tangential distortion", prior_sigma=0.02, start_zero=True)
    s1: float = parameter("thin-prism distortion in x", prior_sigma=0.02, start_zero=True)
    s2: float = parameter("thin-prism distortion in x", prior_sigma=0.02, start_zero=True)
    s3: float = parameter("thin-prism distortion in y", prior_sigma=0.02, start_zero=True)
    s4: float = parameter("thin-prism distortion in y", prior_sigma=0.02, start_zero=True)

    @classmethod
    def example(cls) -> Self:
        return cls(
            fx=281.0,
            fy=280.0,
            cx=479.5,
            cy=481.0,
            k1=0.03,
            k2=-0.011,
            k3=0.0021,
            k4=-0.00019,
            k5=2e-5,
            k6=-3e-6,
            p1=3e-4,
            p2=-5e-4,
            s1=4e-4,
            s2=-3e-5,
            s3=-2e-4,
            s4=2e-5,
        )
