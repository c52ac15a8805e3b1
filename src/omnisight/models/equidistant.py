"""The equidistant (f-theta) fisheye."""

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from omnisight.models._elementwise import atan2, sine_cosine, where
from omnisight.models._parameter import parameter
from omnisight.models._profile_camera import ProfileCamera, derivative_by_cosine
from omnisight.models._projector import Array


class EquidistantProfile(ProfileCamera):
    """r = theta."""

    @staticmethod
    def radial_scale(m: Any, s: Any, c: Any, max_iterations: Any) -> Any:
        return where(s > 1e-9, atan2(s, c) / where(s > 1e-9, s, 1.0), 1.0)

    @staticmethod
    def inverse_radial_scale(m: Any, r: Any, r2: Any, max_iterations: Any) -> Any:
        s, c = sine_cosine(where(r < 3.141592653589793, r, 3.141592653589793))
        return where(r > 1e-9, s / where(r > 1e-9, r, 1.0), 1.0), c

    def radial_scale_derivatives(self, s: Array, c: Array, g: Array) -> tuple[Array, dict[str, Array]]:
        return derivative_by_cosine(s, c, g, slope=s * 0 + 1, at_axis=-1 / 3), {}

    def radius_max(self) -> float:
        return 3.141592653589793


@dataclass(frozen=True)
class Equidistant(EquidistantProfile):
    """Equidistant fisheye: r = theta. Valid for theta < 180 degrees.

    The plainest description of a fisheye, and the circular view of a whole hemisphere.
    """

    auto_max_theta: ClassVar[float] = 0.0

    fx: float = parameter("pixels per radian along x", unit="px")
    fy: float = parameter("pixels per radian along y", unit="px")
    cx: float = parameter("principal point", unit="px")
    cy: float = parameter("principal point", unit="px")

    @classmethod
    def example(cls) -> Self:
        return cls(fx=281.0, fy=280.0, cx=479.5, cy=481.0)
