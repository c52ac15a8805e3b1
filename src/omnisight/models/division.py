"""The division model."""

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from omnisight.models._elementwise import sqrt, where
from omnisight.models._parameter import parameter
from omnisight.models._planar_distortion import FOLD_MARGIN
from omnisight.models._profile_camera import ProfileCamera
from omnisight.models._projector import Array


@dataclass(frozen=True)
class Division(ProfileCamera):
    """Fitzgibbon's division model: a point (x, y) of the plane has the bearing (x, y, 1 + k r^2).

    r = 2 sin(theta)/(cos(theta) + sqrt(cos(theta)^2 - 4 k sin(theta)^2))

    The polynomial model with the terms a0 and a2 alone. k < 0 is a barrel distortion, valid for theta < 180 degrees;
    for k > 0 valid up to tan(theta) = 1/(2 sqrt(k)). Fitzgibbon, Simultaneous linear estimation of multiple view
    geometry and lens distortion, CVPR 2001.
    """

    auto_max_theta: ClassVar[float] = 0.0

    INITIAL_SHAPES: ClassVar = tuple({"k": k} for k in (-0.1, -0.25, -0.5))

    fx: float = parameter("focal length along x", unit="px")
    fy: float = parameter("focal length along y", unit="px")
    cx: float = parameter("principal point", unit="px")
    cy: float = parameter("principal point", unit="px")
    k: float = parameter("distortion")

    @staticmethod
    def radial_scale(m: Any, s: Any, c: Any, max_iterations: Any) -> Any:
        root = sqrt(c * c - 4.0 * m.k * s * s)
        # The two forms of the same root: neither subtracts two numbers that are nearly equal.
        ahead = c > 0.0
        return where(ahead, 2.0, c - root) / where(ahead, c + root, 2.0 * m.k * s * s)

    @staticmethod
    def inverse_radial_scale(m: Any, r: Any, r2: Any, max_iterations: Any) -> Any:
        z = 1.0 + m.k * r2
        h = 1.0 / sqrt(r2 + z * z)
        return h, h * z

    def radial_scale_derivatives(self, s: Array, c: Array, g: Array) -> tuple[Array, dict[str, Array]]:
        root = np.sqrt(c * c - 4 * self.k * s * s)
        return -g * g / 2 * (1 + c * (1 + 4 * self.k) / root), {"k": g * g * s * s / root}

    @property
    def theta_max(self) -> float:
        return np.pi if self.k < 0 else float(np.arctan2(0.5, np.sqrt(self.k))) * (1 - FOLD_MARGIN)

    def radius_max(self) -> float:
        return np.inf if self.k <= 0 else self.k**-0.5

    @classmethod
    def example(cls) -> Self:
        return cls(fx=431.0, fy=430.0, cx=479.5, cy=481.0, k=-0.21)
