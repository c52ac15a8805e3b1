"""Conic sections of revolution: sphere, ellipse, parabola, hyperbola."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from omnisight.models._parameter import parameter
from omnisight.optics.mirrors._mirror import Array, inner_rim, outer_rim
from omnisight.optics.mirrors._quadric import Quadric


@dataclass(frozen=True)
class Conic(Quadric):
    """A conic section rotated about the axis through its foci.

    z(rho) = rho^2 / (R (1 + sqrt(1 - (1 - e^2) rho^2/R^2))), with R the radius of curvature at the vertex and e the
    eccentricity: the sheet of rho^2 + (1 - e^2) z^2 = 2 R z that contains the vertex (for an ellipse half of it).

    R > 0 is convex as seen from the lens, R < 0 concave. The foci are at z = R/(1 + e), the viewpoint of a convex
    mirror, and at z = R/(1 - e), the lens position that gives a single viewpoint.
    """

    radius: float = parameter("radius of curvature at the vertex, half the latus rectum", unit="m", free=False)
    eccentricity: float = parameter("0 sphere, 1 parabola, above it hyperbola", low=0.0, free=False)
    rim: float = outer_rim()
    hole: float = inner_rim()

    def __post_init__(self) -> None:
        """Check that the radius is not 0."""
        super().__post_init__()
        if self.radius == 0:
            raise ValueError(
                "the vertex radius of a conic mirror must not be 0: positive is convex, negative is concave"
            )

    # -- constructors -------------------------------------------------------------------------------------------

    @classmethod
    def sphere(cls, radius: float, rim: float | None = None) -> Self:
        """Make a sphere of a radius (negative: concave). The default rim is that of the hemisphere facing the lens."""
        return cls(radius, 0.0, abs(radius) if rim is None else rim)

    @classmethod
    def parabola(cls, latus_rectum: float, rim: float) -> Self:
        """Make a paraboloid 2 z = rho^2 / R with the latus rectum 2 R (negative: concave)."""
        return cls(latus_rectum / 2, 1.0, rim)

    @classmethod
    def hyperbola(cls, a: float, c: float, rim: float) -> Self:
        """Make the convex hyperboloid with semi-axis a and focal distance 2 c; c > a > 0.

        Raises
        ------
        ValueError
            If c > a > 0 does not hold.
        """
        if not c > a > 0:
            raise ValueError(f"a hyperbola has c > a > 0, got a = {a}, c = {c}")
        return cls((c * c - a * a) / a, c / a, rim)

    @classmethod
    def ellipse(cls, a: float, c: float, rim: float) -> Self:
        """Make the concave ellipsoid with semi-axis a and focal distance 2 c, seen from inside; a > c >= 0.

        Raises
        ------
        ValueError
            If a > c >= 0 does not hold.
        """
        if not a > c >= 0:
            raise ValueError(f"an ellipse has a > c >= 0, got a = {a}, c = {c}")
        return cls(-(a * a - c * c) / a, c / a, rim)

    # -- properties ---------------------------------------------------------------------------------------------

    @property
    def foci(self) -> tuple[float, float]:
        """The z of the foci: R/(1 + e), and R/(1 - e), which is infinite for a parabola."""
        e = self.eccentricity
        return self.radius / (1 + e), self.radius / (1 - e) if e != 1 else -np.copysign(np.inf, self.radius)

    @property
    def latus_rectum(self) -> float:
        """The width of the conic section at its focus, 2 |R|."""
        return 2 * abs(self.radius)

    @property
    def focal_distance(self) -> float:
        """The distance between the foci, 2 e |R| / |1 - e^2|; infinite for a parabola."""
        inner, outer = self.foci
        return abs(inner - outer)

    @property
    def epsilon(self) -> float:
        """The parameter xi of the unified model of this mirror with the lens in its far focus: 2 e/(1 + e^2).

        With the lens in the near focus, which a concave mirror allows, xi = -2 e/(1 + e^2).

        This equals d/sqrt(d^2 + L^2/4) with the focal distance d and the latus rectum L. Table 1 of the book chapter
        prints sqrt(d^2 + 4 l^2), which holds only if l is a quarter of the latus rectum.
        """
        e = self.eccentricity
        return 2 * e / (1 + e * e)

    # -- implementation of Mirror -------------------------------------------------------------------------------

    def profile(self, w: Array) -> tuple[Array, Array, Array]:
        share = (1 - self.eccentricity**2) / self.radius**2
        q = np.sqrt(1 - share * w)
        ds = 0.5 / (self.radius * q)
        return w / (self.radius * (1 + q)), ds, 0.5 * share * ds / (q * q)

    def normal(self, points: ArrayLike) -> Array:
        # Not from the slope, which is infinite at the equator of a sphere.
        p = np.asarray(points, float)
        x, y = p[..., 0] / self.radius, p[..., 1] / self.radius
        square = 1 - (1 - self.eccentricity**2) * (x * x + y * y)
        square = np.where(square > -1e-13, np.maximum(square, 0.0), np.nan)
        n = np.stack([x, y, -np.sqrt(square)], -1)
        return n / np.sqrt((n * n).sum(-1, keepdims=True))

    def chart(self, w: Array) -> tuple[tuple[Array, Array, Array], tuple[Array, Array, Array]]:
        # The rational chart rho = 2 v/(1 + c v^2), z = rho v/R with c = (1 - e^2)/R^2 is smooth at the equator of an
        # ellipsoid; x and y are not.
        c = (1 - self.eccentricity**2) / self.radius**2
        g = 1 / (1 + c * w)
        a = (2 * g, -2 * c * g**2, 4 * c * c * g**3)
        return a, (2 * w * g / self.radius, 2 * g**2 / self.radius, -4 * c * g**3 / self.radius)

    def chart_coordinates(self, x: Array, y: Array) -> tuple[Array, Array]:
        half = 1 + np.sqrt(np.maximum(1 - (1 - self.eccentricity**2) / self.radius**2 * (x * x + y * y), 0.0))
        return x / half, y / half

    def quadric(self) -> tuple[float, float, float, float]:
        return 1.0, 1 - self.eccentricity**2, -self.radius, -float(np.sign(self.radius))

    @property
    def convex(self) -> bool:
        return self.radius > 0

    @classmethod
    def example(cls) -> Self:
        return cls.hyperbola(a=0.028, c=0.0385, rim=0.035)
