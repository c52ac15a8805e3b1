"""The Mercator panorama."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from omnisight.models._cylindrical_projection import CylindricalProjection
from omnisight.models._elementwise import arcsinh, cosh, tanh
from omnisight.models._projector import Array


@dataclass(frozen=True)
class Mercator(CylindricalProjection):
    """Mercator's map: u = fx atan2(x, z) + cx, v = fy asinh(y/hypot(x, z)) + cy.

    Keeps angles, and shows more of up and down than a cylinder. Valid everywhere but straight up and down.
    """

    auto_max_theta: ClassVar[float] = 0.0

    @staticmethod
    def cylinder_height(m: Any, y: Any, q: Any) -> Any:
        return arcsinh(y / q)

    @staticmethod
    def inverse_cylinder_height(m: Any, h: Any) -> Any:
        level = 1.0 / cosh(h)
        return level, tanh(h), True

    @staticmethod
    def cylinder_height_derivative(t: Array) -> Array:
        return 1 / np.sqrt(1 + t * t)
