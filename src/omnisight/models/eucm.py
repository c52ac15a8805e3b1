"""The enhanced unified camera model."""

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from omnisight.models._elementwise import sqrt
from omnisight.models._parameter import parameter
from omnisight.models._planar_distortion import FOLD_MARGIN
from omnisight.models._profile_camera import ProfileCamera
from omnisight.models._projector import Array


@dataclass(frozen=True)
class EnhancedUnified(ProfileCamera):
    """Khomutenko's enhanced unified model: projection onto an ellipsoid or hyperboloid, then a pinhole.

    With d = sqrt(beta (x^2 + y^2) + z^2):  m = (x, y)/(alpha d + (1 - alpha) z),  pixel = K m.

    beta = 1 is the unified model with xi = alpha/(1 - alpha). Valid, for alpha <= 1/2, while the denominator is
    positive; for alpha > 1/2, up to the fold at r^2 = 1/(beta (2 alpha - 1)). Khomutenko, Garcia and Martinet, An
    enhanced unified camera model, RA-L 2016.
    """

    INITIAL_SHAPES: ClassVar = tuple({"alpha": alpha, "beta": 1.0} for alpha in (0.1, 0.4, 0.55, 0.7))

    fx: float = parameter("focal length along x", unit="px")
    fy: float = parameter("focal length along y", unit="px")
    cx: float = parameter("principal point", unit="px")
    cy: float = parameter("principal point", unit="px")
    alpha: float = parameter("share of the conicoid", low=0.0, high=0.999)
    beta: float = parameter("shape of the conicoid", low=1e-3)

    @staticmethod
    def radial_scale(m: Any, s: Any, c: Any, max_iterations: Any) -> Any:
        return 1.0 / (m.alpha * sqrt(m.beta * s * s + c * c) + (1.0 - m.alpha) * c)

    @staticmethod
    def inverse_radial_scale(m: Any, r: Any, r2: Any, max_iterations: Any) -> Any:
        inside = 1.0 - (2.0 * m.alpha - 1.0) * m.beta * r2
        z = (1.0 - m.beta * m.alpha * m.alpha * r2) / (m.alpha * sqrt(inside) + 1.0 - m.alpha)
        h = 1.0 / sqrt(r2 + z * z)
        return h, h * z

    def radial_scale_derivatives(self, s: Array, c: Array, g: Array) -> tuple[Array, dict[str, Array]]:
        alpha, beta = self.alpha, self.beta
        d = np.sqrt(beta * s * s + c * c)
        g2 = g * g
        partials = {"alpha": -g2 * (d - c), "beta": -g2 * alpha * s * s / (2 * d)}
        return -g2 * (alpha * c * (1 - beta) / d + 1 - alpha), partials

    @property
    def theta_max(self) -> float:
        alpha, beta = self.alpha, self.beta
        if alpha <= 0.5:  # the denominator vanishes
            past = np.arctan2(np.sqrt(1 - 2 * alpha), alpha * np.sqrt(beta))
        else:  # d radius / d theta vanishes
            past = np.arctan2(np.sqrt(2 * alpha - 1), (1 - alpha) * np.sqrt(beta))
        return float(np.pi - past) * (1 - FOLD_MARGIN)

    def radius_max(self) -> float:
        return np.inf if self.alpha <= 0.5 else float((self.beta * (2 * self.alpha - 1)) ** -0.5)

    @classmethod
    def example(cls) -> Self:
        return cls(fx=317.0, fy=316.4, cx=638.7, cy=514.4, alpha=0.62, beta=1.08)
