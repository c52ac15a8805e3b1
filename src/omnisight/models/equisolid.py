"""The equisolid (equal-area) fisheye."""

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from omnisight.models._elementwise import sqrt, where
from omnisight.models._parameter import parameter
from omnisight.models._planar_distortion import FOLD_MARGIN
from omnisight.models._profile_camera import ProfileCamera
from omnisight.models._projector import Array


@dataclass(frozen=True)
class Equisolid(ProfileCamera):
    """Equisolid-angle fisheye: r = 2 sin(theta/2). Valid for theta < 180 degrees.

    Equal solid angles have equal areas in the image: the projection of sky cameras.
    """

    auto_max_theta: ClassVar[float] = 0.0

    fx: float = parameter("focal length along x", unit="px")
    fy: float = parameter("focal length along y", unit="px")
    cx: float = parameter("principal point", unit="px")
    cy: float = parameter("principal point", unit="px")

    @staticmethod
    def radial_scale(m: Any, s: Any, c: Any, max_iterations: Any) -> Any:
        # 1 + c = s^2/(1 - c) keeps its digits near theta = pi.
        return sqrt(2.0 / where(c < 0.0, s * s / where(c < 0.0, 1.0 - c, 1.0), 1.0 + c))

    @staticmethod
    def inverse_radial_scale(m: Any, r: Any, r2: Any, max_iterations: Any) -> Any:
        half = 0.5 * r
        return sqrt(where(half < 1.0, (1.0 - half) * (1.0 + half), 0.0)), 1.0 - 2.0 * half * half

    def radial_scale_derivatives(self, s: Array, c: Array, g: Array) -> tuple[Array, dict[str, Array]]:
        return -0.25 * g**3, {}

    @property
    def theta_max(self) -> float:
        return np.pi * (1 - FOLD_MARGIN)  # r stops increasing at 180 degrees, where r does not determine the angle

    def radius_max(self) -> float:
        return 2.0

    @classmethod
    def example(cls) -> Self:
        return cls(fx=281.0, fy=280.0, cx=479.5, cy=481.0)
