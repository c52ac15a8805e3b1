"""The plane mirror."""

from dataclasses import dataclass
from typing import Self

from omnisight.optics.mirrors._mirror import Array, inner_rim, outer_rim
from omnisight.optics.mirrors._quadric import Quadric


@dataclass(frozen=True)
class Plane(Quadric):
    """z = 0: equivalent to a lens at the mirror image of the real one."""

    rim: float = outer_rim()
    hole: float = inner_rim()

    def profile(self, w: Array) -> tuple[Array, Array, Array]:
        return 0.0 * w, 0.0 * w, 0.0 * w

    def quadric(self) -> tuple[float, float, float, float]:
        return 0.0, 0.0, 0.5, 1.0

    @property
    def convex(self) -> bool:
        return True

    @classmethod
    def example(cls) -> Self:
        return cls(rim=0.08)
