"""The stereographic fisheye, and the little planet."""

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from omnisight.models._elementwise import where
from omnisight.models._parameter import parameter
from omnisight.models._profile_camera import ProfileCamera
from omnisight.models._projector import Array


@dataclass(frozen=True)
class Stereographic(ProfileCamera):
    """Stereographic projection: r = 2 tan(theta/2). Valid for theta < 180 degrees.

    Keeps angles; looking down, it is the little planet. The unified model with xi = 1 and half the focal length.
    """

    auto_max_theta: ClassVar[float] = 0.0

    fx: float = parameter("focal length along x", unit="px")
    fy: float = parameter("focal length along y", unit="px")
    cx: float = parameter("principal point", unit="px")
    cy: float = parameter("principal point", unit="px")

    @staticmethod
    def radial_scale(m: Any, s: Any, c: Any, max_iterations: Any) -> Any:
        # 1 + c = s^2/(1 - c) keeps its digits near theta = pi.
        return 2.0 / where(c < 0.0, s * s / where(c < 0.0, 1.0 - c, 1.0), 1.0 + c)

    @staticmethod
    def inverse_radial_scale(m: Any, r: Any, r2: Any, max_iterations: Any) -> Any:
        h = 4.0 / (4.0 + r2)
        return h, 2.0 * h - 1.0

    def radial_scale_derivatives(self, s: Array, c: Array, g: Array) -> tuple[Array, dict[str, Array]]:
        return -0.5 * g * g, {}

    @classmethod
    def example(cls) -> Self:
        return cls(fx=281.0, fy=280.0, cx=479.5, cy=481.0)
