"""The field-of-view model."""

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from omnisight.models._elementwise import atan2, sine_cosine, sqrt, where
from omnisight.models._parameter import parameter
from omnisight.models._profile_camera import ProfileCamera, derivative_by_cosine
from omnisight.models._projector import Array


@dataclass(frozen=True)
class FieldOfView(ProfileCamera):
    """Devernay and Faugeras' FOV model: r = atan(2 tan(theta) tan(omega/2))/omega.

    Past 90 degrees the arc tangent goes on as atan2(2 sin(theta) tan(omega/2), cos(theta)). Valid for theta < 180
    degrees. Devernay and Faugeras, Straight lines have to be straight, Machine Vision and Applications 2001.
    """

    auto_max_theta: ClassVar[float] = 0.0

    INITIAL_SHAPES: ClassVar = tuple({"omega": omega} for omega in (0.5, 0.9, 1.3))

    fx: float = parameter("focal length along x", unit="px")
    fy: float = parameter("focal length along y", unit="px")
    cx: float = parameter("principal point", unit="px")
    cy: float = parameter("principal point", unit="px")
    omega: float = parameter("field of view of the ideal fisheye, rad", low=1e-2, high=3.1)

    @classmethod
    def derived(cls, m: Any) -> dict[str, Any]:
        s, c = sine_cosine(0.5 * m.omega)
        return {**super().derived(m), "two_t": 2.0 * s / c}

    @staticmethod
    def radial_scale(m: Any, s: Any, c: Any, max_iterations: Any) -> Any:
        r = atan2(m.two_t * s, c) / m.omega
        return where(s > 1e-9, r / where(s > 1e-9, s, 1.0), m.two_t / m.omega)

    @staticmethod
    def inverse_radial_scale(m: Any, r: Any, r2: Any, max_iterations: Any) -> Any:
        s, c = sine_cosine(where(r * m.omega < 3.141592653589793, r * m.omega, 3.141592653589793))
        s = s / m.two_t
        inverse_n = 1.0 / sqrt(s * s + c * c)
        h = where(r > 1e-9, s / where(r > 1e-9, r, 1.0), m.omega / m.two_t)
        return h * inverse_n, c * inverse_n

    def radial_scale_derivatives(self, s: Array, c: Array, g: Array) -> tuple[Array, dict[str, Array]]:
        t, omega = np.tan(self.omega / 2), self.omega
        below = c * c + 4 * t * t * s * s
        at_axis = 2 * t / omega * (8 * t * t / 3 - 1)
        dg_dc = derivative_by_cosine(s, c, g, slope=2 * t / (omega * below), at_axis=at_axis)
        return dg_dc, {"omega": (c * (1 + t * t) / below - g) / omega}

    def radius_max(self) -> float:
        return np.pi / self.omega

    @classmethod
    def example(cls) -> Self:
        return cls(fx=430.0, fy=429.0, cx=479.5, cy=481.0, omega=0.92)
