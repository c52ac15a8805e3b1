"""The orthographic fisheye."""

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from omnisight.models._elementwise import sqrt, where
from omnisight.models._parameter import parameter
from omnisight.models._planar_distortion import FOLD_MARGIN
from omnisight.models._profile_camera import ProfileCamera
from omnisight.models._projector import Array


@dataclass(frozen=True)
class Orthographic(ProfileCamera):
    """Orthographic fisheye: r = sin(theta). Valid for theta < 90 degrees, beyond which it is not injective."""

    auto_max_theta: ClassVar[float] = 0.0

    fx: float = parameter("focal length along x", unit="px")
    fy: float = parameter("focal length along y", unit="px")
    cx: float = parameter("principal point", unit="px")
    cy: float = parameter("principal point", unit="px")

    @staticmethod
    def radial_scale(m: Any, s: Any, c: Any, max_iterations: Any) -> Any:
        return 1.0 + 0.0 * c

    @staticmethod
    def inverse_radial_scale(m: Any, r: Any, r2: Any, max_iterations: Any) -> Any:
        return 1.0 + 0.0 * r, sqrt(where(r < 1.0, (1.0 - r) * (1.0 + r), 0.0))

    def radial_scale_derivatives(self, s: Array, c: Array, g: Array) -> tuple[Array, dict[str, Array]]:
        return np.zeros_like(c), {}

    @property
    def theta_max(self) -> float:
        return np.pi / 2 * (1 - FOLD_MARGIN)  # r stops increasing at 90 degrees, where r does not determine the angle

    def radius_max(self) -> float:
        return 1.0

    @classmethod
    def example(cls) -> Self:
        return cls(fx=431.0, fy=430.0, cx=479.5, cy=481.0)
