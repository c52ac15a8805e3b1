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
    """A conic section turned around the axis through its foci.

    z(rho) = rho^2 / (R (1 + sqrt(1 - (1 - e^2) rho^2/R^2))), with R the radius of curvature at the vertex and e the
    eccentricity: the sheet of rho^2 + (1 - e^2) z^2 = 2 R z that holds the vertex, of an ellipse the half of it.

    R > 0 is convex as the lens sees it, R < 0 concave. The foci lie at z = R/(1 + e), which is the viewpoint of a
    convex mirror, and at z = R/(1 - e), where the lens belongs that sees from one point.
    """

    radius: float = parameter("radius of curvature at the vertex, half the latus rectum", unit="m", free=False)
    eccentricity: float = parameter("0 sphere, 1 parabola, above it hyperbola", low=0.0, free=False)
    rim: float = outer_rim()
    hole: float = inner_rim()

    def __post_init__(self) -> None:
        """Refuse a point."""
        super().__post_init__()
        if self.radius == 0:
            raise ValueError("the radius at the vertex of a conic section is not 0: above it convex, below it concave")

    # -- by name ------------------------------------------------------------------------------------------------

    @classmethod
    def sphere(cls, radius: float, rim: float | None = None) -> Self:
        """Make a ball of that radius; below 0 a bowl. All of the half that faces the lens, unless a rim is given."""
        return cls(radius, 0.0, abs(radius) if rim is None else rim)

    @classmethod
    def parabola(cls, latus_rectum: float, rim: float) -> Self:
        """Make a paraboloid 2 z = rho^2 / R of that latus rectum 2 R; below 0 concave."""
        return cls(latus_rectum / 2, 1.0, rim)

    @classmethod
    def hyperbola(cls, a: float, c: float, rim: float) -> Self:
        """Make the convex hyperboloid with the semi-axis a and the foci 2 c apart; c > a > 0.

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
        """Make the concave ellipsoid with the semi-axis a and the foci 2 c apart, seen from within; a > c >= 0.

        Raises
        ------
        ValueError
            If a > c >= 0 does not hold.
        """
        if not a > c >= 0:
            raise ValueError(f"an ellipse has a > c >= 0, got a = {a}, c = {c}")
        return cls(-(a * a - c * c) / a, c / a, rim)

    # -- what is known of it ------------------------------------------------------------------------------------

    @property
    def foci(self) -> tuple[float, float]:
        """Where on the axis the foci are: R/(1 + e), and R/(1 - e), which a parabola has at infinity."""
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
        """The parameter of the unified model of this mirror with the lens in its focus: 2 e/(1 + e^2).

        Equal to d/sqrt(d^2 + L^2/4) with the distance d between the foci and the latus rectum L. Table 1 of the
        chapter prints sqrt(d^2 + 4 l^2), which holds only if l is a quarter of the latus rectum.
        """
        e = self.eccentricity
        return 2 * e / (1 + e * e)

    # -- the mirror ---------------------------------------------------------------------------------------------

    def profile(self, w: Array) -> tuple[Array, Array, Array]:
        share = (1 - self.eccentricity**2) / self.radius**2
        q = np.sqrt(1 - share * w)
        ds = 0.5 / (self.radius * q)
        return w / (self.radius * (1 + q)), ds, 0.5 * share * ds / (q * q)

    def normal(self, points: ArrayLike) -> Array:
        # Without the slope, which is infinite where a ball is widest.
        p = np.asarray(points, float)
        x, y = p[..., 0] / self.radius, p[..., 1] / self.radius
        square = 1 - (1 - self.eccentricity**2) * (x * x + y * y)
        square = np.where(square > -1e-13, np.maximum(square, 0.0), np.nan)
        n = np.stack([x, y, -np.sqrt(square)], -1)
        return n / np.sqrt((n * n).sum(-1, keepdims=True))

    def chart(self, w: Array) -> tuple[tuple[Array, Array, Array], tuple[Array, Array, Array]]:
        # The rational one, rho = 2 v/(1 + c v^2) and z = rho v/R with c = (1 - e^2)/R^2: smooth where an ellipse is
        # widest, which x and y are not.
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
