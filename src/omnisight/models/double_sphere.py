"""The double sphere model."""

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from omnisight.models._elementwise import sqrt
from omnisight.models._parameter import parameter
from omnisight.models._planar_distortion import FOLD_MARGIN
from omnisight.models._profile_camera import ProfileCamera
from omnisight.models._projector import Array


@dataclass(frozen=True)
class DoubleSphere(ProfileCamera):
    """Usenko's double sphere: two unit spheres xi apart, then a pinhole shifted by alpha/(1 - alpha).

    With d1 = |X| and d2 = |(x, y, xi d1 + z)|:  m = (x, y)/(alpha d2 + (1 - alpha)(xi d1 + z)),  pixel = K m.

    Valid where z > -w2 d1 with w1 = alpha/(1 - alpha) if alpha <= 1/2, else (1 - alpha)/alpha, and
    w2 = (w1 + xi)/sqrt(2 w1 xi + xi^2 + 1). Usenko, Demmel and Cremers, The double sphere camera model, 3DV 2018.
    """

    INITIAL_SHAPES: ClassVar = tuple(
        {"xi": xi, "alpha": alpha}
        for xi, alpha in ((0.0, 0.2), (-0.2, 0.6), (0.0, 0.55), (0.3, 0.7), (0.8, 0.72), (0.97, 0.9), (1.1, 0.6))
    )

    fx: float = parameter("focal length along x", unit="px")
    fy: float = parameter("focal length along y", unit="px")
    cx: float = parameter("principal point", unit="px")
    cy: float = parameter("principal point", unit="px")
    xi: float = parameter("distance between the spheres", low=-0.999, high=4.0, start_scale=0.4)
    alpha: float = parameter("share of the second sphere", low=0.0, high=0.999, start_range=(0.4, 0.8))

    @staticmethod
    def radial_scale(m: Any, s: Any, c: Any, max_iterations: Any) -> Any:
        k = m.xi + c
        return 1.0 / (m.alpha * sqrt(s * s + k * k) + (1.0 - m.alpha) * k)

    @staticmethod
    def inverse_radial_scale(m: Any, r: Any, r2: Any, max_iterations: Any) -> Any:
        inside = 1.0 - (2.0 * m.alpha - 1.0) * r2
        z = (1.0 - m.alpha * m.alpha * r2) / (m.alpha * sqrt(inside) + 1.0 - m.alpha)
        h = (z * m.xi + sqrt(z * z + (1.0 - m.xi * m.xi) * r2)) / (z * z + r2)
        return h, h * z - m.xi

    def radial_scale_derivatives(self, s: Array, c: Array, g: Array) -> tuple[Array, dict[str, Array]]:
        alpha, k = self.alpha, self.xi + c
        d2 = np.sqrt(s * s + k * k)
        g2 = g * g
        by_xi = -g2 * (alpha * k / d2 + 1 - alpha)
        return -g2 * (alpha * self.xi / d2 + 1 - alpha), {"xi": by_xi, "alpha": -g2 * (d2 - k)}

    @property
    def theta_max(self) -> float:
        xi, alpha = self.xi, self.alpha
        w1 = alpha / (1 - alpha) if alpha <= 0.5 else (1 - alpha) / alpha
        c_min = -(w1 + xi) / np.sqrt(2 * w1 * xi + xi * xi + 1)
        if xi > 1:  # the first sphere folds before the second
            c_min = max(c_min, -1 / xi)
        return float(np.arccos(np.clip(c_min, -1, 1))) * (1 - FOLD_MARGIN)

    def radius_max(self) -> float:
        theta = self.theta_max
        k = self.xi + np.cos(theta)
        s = np.sin(theta)
        return float(s / (self.alpha * np.hypot(s, k) + (1 - self.alpha) * k)) * (1 + 1e-12)

    @classmethod
    def example(cls) -> Self:
        return cls(fx=313.2, fy=312.8, cx=638.7, cy=514.4, xi=-0.18, alpha=0.59)
