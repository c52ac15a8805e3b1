"""Distortions of the normalised plane between the profile and the affine map (mixins of camera models)."""

import itertools
from functools import cached_property
from typing import Any

import numpy as np

from omnisight.models._elementwise import (
    absolute,
    any_of,
    elementwise,
    has_derivatives,
    model_method,
    rounding,
    sqrt,
    where,
    without_gradient,
)
from omnisight.models._polynomial_roots import first_positive_root
from omnisight.models._projector import Array, Partial

# The inverse is singular at a fold: the valid domain ends at this relative distance before it.
FOLD_MARGIN = 1e-6
# Radius at which a plane that never folds is cut off (89.94 degrees of a pinhole).
MAX_PLANE_RADIUS = 1e3
# Rounding error of a squared distance, relative to the squared radius, in squared units of `rounding`: 1e-29.
SQUARED_ROUNDING = 203.0
# Largest squared error before the last Newton step, which the step squares, in units of `rounding`: 1e-14.
MAX_SQUARED_ERROR = 45.0
# Relative radii at which the plane is tested for a fold, and the number of refinements of the first fold.
RELATIVE_RADII, FOLD_REFINEMENTS = np.linspace(0.01, 1, 100) ** 3, 5
# Directions in which each radius is tested; between them the plane may fold up to this share earlier.
UNIT_CIRCLE = np.array((np.cos(AZIMUTHS := 2 * np.pi / 32 * np.arange(32)), np.sin(AZIMUTHS)))
AZIMUTH_MARGIN = 0.02


@model_method
def distort(m: Any, x: Any, y: Any) -> Any:
    """Return the distorted point of the plane."""


@model_method
def undistort(m: Any, x: Any, y: Any, max_iterations: Any) -> Any:
    """Return (x, y, converged), the inverse of `distort`."""


@model_method
def distort_jacobian(m: Any, x: Any, y: Any) -> Any:
    """Return (dx/dx, dx/dy, dy/dx, dy/dy) of `distort`."""


@model_method
def first_newton_steps(m: Any, p: Any, q: Any, x: Any, y: Any) -> Any:
    """Return (p, q) after the Newton steps that every point takes before the last two."""


@elementwise
def newton_step(m: Any, p: Any, q: Any, x: Any, y: Any) -> Any:
    """Return (p, q) after a Newton step towards `distort` = (x, y), and an estimate of the squared error.

    The estimate is the squared residual before the step, which the step reduces to about its square; near a fold the
    error is larger because of the determinant that vanishes there.
    """
    dx, dy = distort(m, p, q)
    dx, dy = dx - x, dy - y
    xx, xy, yx, yy = distort_jacobian(m, p, q)
    inverse_det = 1.0 / (xx * yy - xy * yx)
    excess = dx * dx + dy * dy - SQUARED_ROUNDING * rounding(x) * rounding(x) * (1.0 + x * x + y * y)
    magnified = absolute(inverse_det * inverse_det * inverse_det)
    error = where(excess > 0.0, excess, 0.0) * where(absolute(inverse_det) > 1.0, magnified, 1.0)
    return p - (yy * dx - xy * dy) * inverse_det, q - (xx * dy - yx * dx) * inverse_det, error


class NoDistortion:
    """The identity."""

    def projection_constants(self) -> dict[str, Any]:
        """Return the constants that `distort` needs besides the parameters."""
        return {}

    def unprojection_constants(self) -> dict[str, Any]:
        """Return the constants that only `undistort` needs."""
        return {}

    @classmethod
    def derived(cls, m: Any) -> dict[str, Any]:
        """Return functions of the parameters that the formulas need too; see `CameraModel.derived`."""
        return {}

    @staticmethod
    def distort(m: Any, x: Any, y: Any) -> Any:
        return x, y

    @staticmethod
    def undistort(m: Any, x: Any, y: Any, max_iterations: Any) -> Any:
        return x, y, True

    @staticmethod
    def distort_jacobian(m: Any, x: Any, y: Any) -> Any:
        return 1.0, 0.0, 0.0, 1.0

    def distort_partials(self, x: Array, y: Array) -> dict[str, tuple[Partial, Partial]]:
        """Return the derivatives of the distorted point by field: (N,), or (K, N) for a tuple of K parameters."""
        return {}

    def radius_max(self) -> float:
        """Return the radius, before the distortion, of the rim of the valid cone."""
        return np.inf

    def plane_radius_max(self) -> float:
        """Return the radius of the disc on which the distortion is one-to-one."""
        return np.inf

    @cached_property
    def one_to_one_radius(self) -> float:
        """The radius of the disc on which the distortion is one-to-one."""
        return self.plane_radius_max()


class PlanarDistortion(NoDistortion):
    """A distortion inverted by Newton's method; a subclass implements `distort` and its derivatives."""

    @staticmethod
    def undistort(m: Any, x: Any, y: Any, max_iterations: Any) -> Any:
        d2 = x * x + y * y
        largest = MAX_SQUARED_ERROR * rounding(x) * (1.0 + d2)
        error = d2
        if max_iterations is None:
            p, q = first_newton_steps(m, x, y, x, y)
        else:
            # A strong distortion moves the rim far out: start in the one-to-one disc, and return to it from outside by
            # an inversion in its rim.
            back = where(d2 > m.p2_max, sqrt(m.p2_max / where(d2 > 0.0, d2, 1.0)), 1.0)
            p, q = back * x, back * y
            for _ in range(max_iterations):
                p, q, error = newton_step(m, p, q, x, y)
                p2 = p * p + q * q
                back = where(p2 > m.p2_max, m.p2_max / where(p2 > 0.0, p2, 1.0), 1.0)
                p, q = back * p, back * q
                if not any_of((error >= largest) & (d2 <= m.d2_max)):
                    break
        if max_iterations is None or has_derivatives(p):
            p, q, _ = newton_step(m, without_gradient(p), without_gradient(q), x, y)
            p, q, error = newton_step(m, p, q, x, y)
        close = (error < largest) & (p * p + q * q <= 1.05 * m.p2_max)
        return where(d2 <= m.d2_max, p, np.nan), q, close | (d2 > m.d2_max)

    @staticmethod
    def first_newton_steps(m: Any, p: Any, q: Any, x: Any, y: Any) -> Any:
        """Return (p, q) after three Newton steps."""
        # Unrolled: the compiled loop over the points then vectorizes.
        p, q, _ = newton_step(m, p, q, x, y)
        p, q, _ = newton_step(m, p, q, x, y)
        p, q, _ = newton_step(m, p, q, x, y)
        return p, q

    def unprojection_constants(self) -> dict[str, Any]:
        azimuth = np.linspace(0, 2 * np.pi, 32, endpoint=False)
        radius = self.one_to_one_radius
        x, y = self.distort(self, radius * np.cos(azimuth), radius * np.sin(azimuth))
        return {**super().unprojection_constants(), "d2_max": 1.05 * float((x * x + y * y).max()), "p2_max": radius**2}

    def radial_fold(self) -> float:
        """Return the radius at which the radial part alone stops increasing."""
        return np.inf

    def plane_radius_max(self) -> float:
        return self.radius_without_fold(
            min(self.radial_fold() * (1 - FOLD_MARGIN), self.radius_max(), MAX_PLANE_RADIUS)
        )

    def radius_without_fold(self, radius: float) -> float:
        """Return the largest radius, at most the given one, of a disc in which the plane does not fold."""
        # With strong tangential parts the plane folds before the radial part does.
        shares = RELATIVE_RADII
        low = 0.0
        for _ in range(FOLD_REFINEMENTS):
            smallest = self._min_area_scale(radius * shares)
            folded = np.flatnonzero(smallest <= 0)
            if not len(folded):
                return radius
            first = folded[0]
            low, high = shares[first - 1] if first else low, shares[first]
            shares = np.linspace(low, high, 17)[1:]
        return float(radius * low * (1 - FOLD_MARGIN - AZIMUTH_MARGIN * (1 - low)))

    def _min_area_scale(self, radii: Array) -> Array:
        """Return the smallest area magnification on each circle."""
        xx, xy, yx, yy = self.distort_jacobian(self, radii[:, None] * UNIT_CIRCLE[0], radii[:, None] * UNIT_CIRCLE[1])
        return np.min(xx * yy - xy * yx, axis=1)


class RadialDistortion(PlanarDistortion):
    """A distortion with a radial part."""

    def slope_polynomial(self) -> list[float]:
        """Return a polynomial in r^2 with the sign of the radial slope: coefficients from the constant up."""
        raise NotImplementedError

    def radial_fold(self) -> float:
        return first_positive_root(self.slope_polynomial()) ** 0.5


class RadialTangentialDistortion(RadialDistortion):
    """Brown's distortion with coefficients k1, k2 (radial) and p1, p2 (tangential).

    x' = x (1 + k1 r^2 + k2 r^4) + 2 p1 x y + p2 (r^2 + 2 x^2)
    y' = y (1 + k1 r^2 + k2 r^4) + p1 (r^2 + 2 y^2) + 2 p2 x y
    """

    k1: float
    k2: float
    p1: float
    p2: float

    @staticmethod
    def distort(m: Any, x: Any, y: Any) -> Any:
        r2 = x * x + y * y
        radial = 1.0 + r2 * (m.k1 + r2 * m.k2)
        dx = 2.0 * m.p1 * x * y + m.p2 * (r2 + 2.0 * x * x)
        dy = m.p1 * (r2 + 2.0 * y * y) + 2.0 * m.p2 * x * y
        return x * radial + dx, y * radial + dy

    @staticmethod
    def distort_jacobian(m: Any, x: Any, y: Any) -> Any:
        r2 = x * x + y * y
        radial = 1.0 + r2 * (m.k1 + r2 * m.k2)
        slope = 2.0 * (m.k1 + 2.0 * r2 * m.k2)  # d radial / d r2, doubled
        cross = x * y * slope + 2.0 * (m.p1 * x + m.p2 * y)
        xx = radial + x * x * slope + 2.0 * m.p1 * y + 6.0 * m.p2 * x
        yy = radial + y * y * slope + 6.0 * m.p1 * y + 2.0 * m.p2 * x
        return xx, cross, cross, yy

    def distort_partials(self, x: Array, y: Array) -> dict[str, tuple[Partial, Partial]]:
        r2 = x * x + y * y
        return {"k1": (x * r2, y * r2), "k2": (x * r2**2, y * r2**2)} | tangential_partials(x, y)

    def slope_polynomial(self) -> list[float]:
        return [1.0, 3 * self.k1, 5 * self.k2]

    def radius_without_fold(self, radius: float) -> float:
        # Without p1, p2 the eigenvalues of the Jacobian are the radial factor and the radial slope. p1 and p2 change
        # them by at most 6 |p| r (Weyl), which usually suffices to exclude a fold.
        smallest = min(
            quadratic_minimum(*terms, end=radius**2) for terms in ([1.0, self.k1, self.k2], self.slope_polynomial())
        )
        if smallest > 6 * np.hypot(self.p1, self.p2) * radius:
            return radius
        return super().radius_without_fold(radius)


def quadratic_minimum(a: float, b: float, c: float, end: float) -> float:
    """Return the minimum of a + b q + c q^2 for 0 <= q <= end."""
    lowest = -b / (2 * c) if c > 0 else 0.0
    return min(a + q * (b + q * c) for q in (0.0, min(max(lowest, 0.0), end), end))


def tangential_partials(x: Array, y: Array) -> dict[str, tuple[Partial, Partial]]:
    """Return the derivatives by p1 and p2."""
    r2 = x * x + y * y
    return {"p1": (2 * x * y, r2 + 2 * y * y), "p2": (r2 + 2 * x * x, 2 * x * y)}


class RationalDistortion(RadialDistortion):
    """OpenCV's rational distortion with k1 ... k6 and p1, p2; missing coefficients are 0."""

    k1: float
    k2: float
    k3: float
    k4: float = 0.0
    k5: float = 0.0
    k6: float = 0.0

    @staticmethod
    def distort(m: Any, x: Any, y: Any) -> Any:
        r2 = x * x + y * y
        radial = (1.0 + r2 * (m.k1 + r2 * (m.k2 + r2 * m.k3))) / (1.0 + r2 * (m.k4 + r2 * (m.k5 + r2 * m.k6)))
        dx = 2.0 * m.p1 * x * y + m.p2 * (r2 + 2.0 * x * x)
        dy = m.p1 * (r2 + 2.0 * y * y) + 2.0 * m.p2 * x * y
        return x * radial + dx, y * radial + dy

    @staticmethod
    def distort_jacobian(m: Any, x: Any, y: Any) -> Any:
        r2 = x * x + y * y
        inverse = 1.0 / (1.0 + r2 * (m.k4 + r2 * (m.k5 + r2 * m.k6)))
        radial = (1.0 + r2 * (m.k1 + r2 * (m.k2 + r2 * m.k3))) * inverse
        slope = m.k1 + r2 * (2.0 * m.k2 + r2 * 3.0 * m.k3)
        slope = 2.0 * inverse * (slope - radial * (m.k4 + r2 * (2.0 * m.k5 + r2 * 3.0 * m.k6)))
        cross = x * y * slope + 2.0 * (m.p1 * x + m.p2 * y)
        xx = radial + x * x * slope + 2.0 * m.p1 * y + 6.0 * m.p2 * x
        yy = radial + y * y * slope + 6.0 * m.p1 * y + 2.0 * m.p2 * x
        return xx, cross, cross, yy

    def distort_partials(self, x: Array, y: Array) -> dict[str, tuple[Partial, Partial]]:
        r2 = x * x + y * y
        inverse = 1.0 / (1.0 + r2 * (self.k4 + r2 * (self.k5 + r2 * self.k6)))
        radial = (1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))) * inverse
        above = {f"k{i}": r2**i * inverse for i in (1, 2, 3)}
        below = {f"k{i + 3}": -radial * r2**i * inverse for i in (1, 2, 3)}
        partials = {name: (x * d, y * d) for name, d in (above | below).items()}
        return partials | tangential_partials(x, y)

    def slope_polynomial(self) -> list[float]:
        # d/dr [r N/D] D^2 with N, D polynomials in q = r^2:  (N + 2 q N') D - 2 q N D'.
        n, d = (1.0, self.k1, self.k2, self.k3), (1.0, self.k4, self.k5, self.k6)
        terms = [0.0] * 7
        for i, j in itertools.product(range(4), range(4)):
            terms[i + j] += (1 + 2 * i - 2 * j) * n[i] * d[j]
        return terms
