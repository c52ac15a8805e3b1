"""Kannala and Brandt's fisheye, four coefficients."""

from dataclasses import dataclass
from typing import ClassVar, Self

from omnisight.models._parameter import parameter
from omnisight.models._theta_polynomial import ThetaPolynomial


@dataclass(frozen=True)
class KannalaBrandt(ThetaPolynomial):
    """Kannala and Brandt's radial polynomial: r = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8).

    The same as OpenCV fisheye, Kalibr pinhole-equidistant, COLMAP OPENCV_FISHEYE, and camodocal's KANNALA_BRANDT, which
    counts k2 ... k5. Valid up to the angle where r stops increasing, at most 180 degrees. Kannala and Brandt, A generic
    camera model and calibration method for conventional, wide-angle, and fish-eye lenses, PAMI 2006.
    """

    in_initial_search: ClassVar[bool] = True
    INITIAL_SHAPES: ClassVar = tuple({"k1": k, "k2": 0.0, "k3": 0.0, "k4": 0.0} for k in (0.0, -0.04, 0.08))

    fx: float = parameter("focal length along x", unit="px")
    fy: float = parameter("focal length along y", unit="px")
    cx: float = parameter("principal point", unit="px")
    cy: float = parameter("principal point", unit="px")
    k1: float = parameter("coefficient of theta^3")
    k2: float = parameter("coefficient of theta^5")
    k3: float = parameter("coefficient of theta^7")
    k4: float = parameter("coefficient of theta^9")

    @classmethod
    def example(cls) -> Self:
        return cls(fx=281.0, fy=280.0, cx=479.5, cy=481.0, k1=0.03, k2=-0.011, k3=0.0021, k4=-0.00019)
