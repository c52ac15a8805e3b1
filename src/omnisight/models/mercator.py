"""The Mercator panorama."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from omnisight.models._projector import Array
from omnisight.models._unrolled import Unrolled


@dataclass(frozen=True)
class Mercator(Unrolled):
    """Mercator's map: u = fx atan2(x, z) + cx, v = fy asinh(y/hypot(x, z)) + cy.

    Keeps angles, and shows more of up and down than a cylinder. Valid everywhere but straight up and down.
    """

    auto_max_theta: ClassVar[float] = 0.0

    @staticmethod
    def height(m: Any, y: Any, q: Any) -> Any:
        return np.arcsinh(y / q)

    @staticmethod
    def unheight(m: Any, h: Any) -> Any:
        level = 1.0 / np.cosh(h)
        return level, np.tanh(h), True

    @staticmethod
    def height_slope(t: Array) -> Array:
        return 1 / np.sqrt(1 + t * t)
