"""The conical mirror."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from omnisight.models._parameter import parameter
from omnisight.optics.mirrors._mirror import Array, inner_rim, outer_rim
from omnisight.optics.mirrors._quadric import Quadric


@dataclass(frozen=True)
class Cone(Quadric):
    """z = rho / tan(half_angle): a cone with its apex towards the lens, or a funnel if half_angle > 90 degrees.

    The apex has no normal and reflects nothing. A pinhole on the axis sees viewpoints on a circle; a single viewpoint
    would need the pinhole at the apex (Baker and Nayar, A theory of single-viewpoint catadioptric image formation, IJCV
    1999, section 3.3).
    """

    half_angle: float = parameter("angle between the axis and the surface", unit="rad", low=0.0, high=np.pi, free=False)
    rim: float = outer_rim()
    hole: float = inner_rim()

    def __post_init__(self) -> None:
        """Check the half angle."""
        super().__post_init__()
        if self.half_angle <= 0 or self.half_angle >= np.pi:
            raise ValueError(f"the half angle of a cone must be between 0 and pi radians, got {self.half_angle:g}")

    @property
    def slope(self) -> float:
        """The derivative of the sag by rho."""
        return 1 / float(np.tan(self.half_angle))

    def profile(self, w: Array) -> tuple[Array, Array, Array]:
        rho = np.sqrt(w)
        ds = 0.5 * self.slope / rho
        return self.slope * rho, ds, -0.5 * ds / w

    def quadric(self) -> tuple[float, float, float, float]:
        return self.slope**2, -1.0, 0.0, -float(np.sign(self.slope))

    @property
    def convex(self) -> bool:
        return self.slope >= 0

    @classmethod
    def example(cls) -> Self:
        return cls(half_angle=np.radians(55.0), rim=0.06)
