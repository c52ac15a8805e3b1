"""The cylindrical panorama."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from omnisight.models._cylindrical_projection import CylindricalProjection
from omnisight.models._elementwise import sqrt
from omnisight.models._projector import Array


@dataclass(frozen=True)
class Cylindrical(CylindricalProjection):
    """The image on a cylinder around the y axis: u = fx atan2(x, z) + cx, v = fy y/hypot(x, z) + cy.

    Upright lines stay straight. Valid everywhere but straight up and down.
    """

    auto_max_theta: ClassVar[float] = 0.0

    @staticmethod
    def cylinder_height(m: Any, y: Any, q: Any) -> Any:
        return y / q

    @staticmethod
    def inverse_cylinder_height(m: Any, h: Any) -> Any:
        level = 1.0 / sqrt(1.0 + h * h)
        return level, h * level, True

    @staticmethod
    def cylinder_height_derivative(t: Array) -> Array:
        return np.ones_like(t)
