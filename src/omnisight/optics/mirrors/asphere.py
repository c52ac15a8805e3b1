"""Even aspheres: a conic section plus a polynomial."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.models._parameter import parameter
from omnisight.optics.mirrors._mirror import RIM_TOLERANCE, Array, Mirror, inner_rim


@dataclass(frozen=True)
class Asphere(Mirror):
    """z(rho) = C rho^2 / (1 + sqrt(1 - (1 + k) C^2 rho^2)) + b0 rho^4 + b1 rho^6 + ...

    The even asphere of optical design (ISO 10110-12): curvature C at the vertex, conic constant k = -e^2, and
    coefficients of the even powers from the fourth. The square root must be real up to the rim.
    """

    curvature: float = parameter("curvature at the vertex, 1/R", unit="1/m", free=False)
    conic: float = parameter("conic constant, -e^2", free=False)
    b: tuple[float, ...] = parameter("coefficient of rho^4, rho^6, ...", default=(0.0,), free=False)
    rim: float = parameter("distance of the rim from the axis", unit="m", low=0.0, default=0.05, free=False)
    hole: float = inner_rim()

    def __post_init__(self) -> None:
        """Check that the profile is defined up to the rim."""
        super().__post_init__()
        if not np.isfinite(self.rim) or (1 + self.conic) * (self.curvature * self.rim) ** 2 >= 1:
            raise ValueError(
                "the profile of an asphere must be defined up to its rim: (1 + conic) (curvature rim)^2 < 1, got conic"
                f" {self.conic:g}, curvature {self.curvature:g} and rim {self.rim:g}"
            )

    def profile(self, w: Array) -> tuple[Array, Array, Array]:
        c, share = self.curvature, (1 + self.conic) * self.curvature**2
        q = np.sqrt(1 - share * w)
        s, ds = c * w / (1 + q), 0.5 * c / q
        dds = 0.5 * share * ds / (q * q)
        for i, b in enumerate(self.b, start=2):
            s, ds, dds = s + b * w**i, ds + i * b * w ** (i - 1), dds + i * (i - 1) * b * w ** (i - 2)
        return s, ds, dds

    def on_sheet(self, a: Array, b: Array) -> NDArray[np.bool_]:
        # The polynomial is not meaningful beyond the rim.
        return a * a + b * b <= self.rim**2 * (1 + RIM_TOLERANCE)

    @classmethod
    def example(cls) -> Self:
        return cls(curvature=18.0, conic=-1.8, b=(600.0, -5e4), rim=0.04)
