"""The conical mirror."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from omnisight.models._parameter import parameter
from omnisight.optics.mirrors._mirror import Array, inner_rim, outer_rim
from omnisight.optics.mirrors._quadric import Quadric


@dataclass(frozen=True)
class Cone(Quadric):
    """z = rho / tan(half_angle): its tip towards the lens, or, past 90 degrees, a funnel.

    The tip has no normal and shows nothing. Of a pinhole on the axis the viewpoints lie on a circle (Baker and Nayar, A
    theory of single-viewpoint catadioptric image formation, IJCV 1999, 3.3: the pinhole would have to be the tip).
    """

    half_angle: float = parameter("angle between the axis and the surface", unit="rad", low=0.0, high=np.pi, free=False)
    rim: float = outer_rim()
    hole: float = inner_rim()

    def __post_init__(self) -> None:
        """Refuse a needle."""
        super().__post_init__()
        if self.half_angle <= 0 or self.half_angle >= np.pi:
            raise ValueError(f"the half angle of a cone lies between 0 and pi (radians), got {self.half_angle:g}")

    @property
    def slope(self) -> float:
        """How fast the sag grows with rho."""
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
