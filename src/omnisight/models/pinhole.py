"""The pinhole camera."""

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from omnisight.models._elementwise import sqrt
from omnisight.models._parameter import parameter
from omnisight.models._profile_camera import ProfileCamera
from omnisight.models._projector import Array


class PinholeProfile(ProfileCamera):
    """r = tan(theta)."""

    @staticmethod
    def radial_scale(m: Any, s: Any, c: Any, max_iterations: Any) -> Any:
        return 1.0 / c

    @staticmethod
    def inverse_radial_scale(m: Any, r: Any, r2: Any, max_iterations: Any) -> Any:
        c = 1.0 / sqrt(1.0 + r2)
        return c, c

    def radial_scale_derivatives(self, s: Array, c: Array, g: Array) -> tuple[Array, dict[str, Array]]:
        return -g * g, {}

    @property
    def theta_max(self) -> float:
        return np.pi / 2


@dataclass(frozen=True)
class Pinhole(PinholeProfile):
    """Pinhole camera with skew: r = tan(theta).

    u = fx x/z + skew y/z + cx,  v = fy y/z + cy

    Valid for theta < 90 degrees. In the chapter's eq. (5) skew = -alpha_u cot(angle) and alpha_v already holds
    1/sin(angle).
    """

    auto_max_theta: ClassVar[float] = 0.0

    fx: float = parameter("focal length along x", unit="px")
    fy: float = parameter("focal length along y", unit="px")
    cx: float = parameter("principal point", unit="px")
    cy: float = parameter("principal point", unit="px")
    skew: float = parameter("skew of the pixel axes", unit="px", default=0.0, free=False)

    @classmethod
    def example(cls) -> Self:
        return cls(fx=610.0, fy=612.0, cx=639.5, cy=362.0, skew=0.7)
