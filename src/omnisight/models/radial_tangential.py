"""The pinhole camera with radial and tangential distortion, five coefficients."""

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from omnisight.models._parameter import parameter
from omnisight.models._planar_distortion import RationalDistortion
from omnisight.models.pinhole import PinholeProfile


@dataclass(frozen=True)
class RadialTangentialPinhole(RationalDistortion, PinholeProfile):
    """Pinhole camera with Brown's distortion; ROS `plumb_bob`, OpenCV's five coefficients.

    On the plane x/z, y/z, with r^2 = x^2 + y^2:

    x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
    y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y

    Valid for theta < 90 degrees and up to the radius where x' stops increasing. Brown, Decentering distortion of
    lenses, 1966.
    """

    auto_max_theta: ClassVar[float] = np.radians(62.0)  # planar distortion becomes unstable beyond

    fx: float = parameter("focal length along x", unit="px")
    fy: float = parameter("focal length along y", unit="px")
    cx: float = parameter("principal point", unit="px")
    cy: float = parameter("principal point", unit="px")
    k1: float = parameter("radial distortion")
    k2: float = parameter("radial distortion")
    p1: float = parameter("tangential distortion", start_zero=True)
    p2: float = parameter("tangential distortion", start_zero=True)
    k3: float = parameter("radial distortion")

    def projection_constants(self) -> dict[str, Any]:
        return super().projection_constants() | {"k4": 0.0, "k5": 0.0, "k6": 0.0}

    @classmethod
    def example(cls) -> Self:
        return cls(fx=610.0, fy=612.0, cx=639.5, cy=362.0, k1=-0.28, k2=0.09, p1=4e-4, p2=-3e-4, k3=-0.012)
