"""Distortions of the normalised plane, between a profile and the pixels (mixins of camera models)."""

import itertools
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from omnisight.models._elementwise import distort, distort_jacobian, first_steps, inverse_step, settled, where
from omnisight.models._projector import Array, Partial

# The inverse is singular where the plane folds over: the valid disc ends this share before it.
FOLD_MARGIN = 1e-6
# A plane that never folds is followed to this radius (89.94 degrees of a pinhole).
FARTHEST = 1e3
# Squared share of a point's radius that is only rounding.
ROUNDED = 1e-29
# Circles on which a plane is asked whether it folds, as shares of the largest, and how often more closely.
SHARES, CLOSER = np.linspace(0.01, 1, 100) ** 3, 5
# Points around each, between which it may fold a little before it does at them, if not as a circle.
CIRCLE = np.array((np.cos(AROUND := 2 * np.pi / 32 * np.arange(32)), np.sin(AROUND)))
AROUND_MARGIN = 0.02


class Undistorted:
    """The plane as it is."""

    def derived(self) -> dict[str, Any]:
        """Give the constants that `distort` needs beside the parameters."""
        return {}

    def derived_back(self) -> dict[str, Any]:
        """Give the constants that only `undistort` needs."""
        return {}

    @staticmethod
    def distort(m: Any, x: Any, y: Any) -> Any:
        return x, y

    @staticmethod
    def undistort(m: Any, x: Any, y: Any, effort: Any) -> Any:
        return x, y, True

    @staticmethod
    def distort_jacobian(m: Any, x: Any, y: Any) -> Any:
        return 1.0, 0.0, 0.0, 1.0

    def distort_partials(self, x: Array, y: Array) -> dict[str, tuple[Partial, Partial]]:
        """Give the derivatives of the distorted point by field: (N,), or (K, N) of a tuple of K."""
        return {}

    def radius_max(self) -> float:
        """Give the radius, before the planar map, of the rim of the valid cone."""
        return np.inf

    def plane_radius_max(self) -> float:
        """Give the radius of the disc of the plane on which the distortion is one-to-one."""
        return np.inf

    @cached_property
    def disc(self) -> float:
        """`plane_radius_max`, found once."""
        return self.plane_radius_max()


class Distorted(Undistorted):
    """A distortion inverted by Newton's method; a subclass writes `distort` and its derivatives."""

    @staticmethod
    def undistort(m: Any, x: Any, y: Any, effort: Any) -> Any:
        d2 = x * x + y * y
        p, q = x, y
        if effort is None:
            p, q, missed = first_steps(m, p, q, x, y)
        else:
            missed = d2
            # A strong distortion sends the rim far out: begin in the disc on which the plane is one-to-one, and come
            # back to it from outside by a reflection in its rim.
            back = where(d2 > m.p2_max, np.sqrt(m.p2_max / where(d2 > 0.0, d2, 1.0)), 1.0)
            for _ in range(effort):
                p, q, missed = inverse_step(m, back * p, back * q, x, y)
                p2 = p * p + q * q
                back = where(p2 > m.p2_max, m.p2_max / where(p2 > 0.0, p2, 1.0), 1.0)
                if settled(missed, 1e-28):
                    break
        # What was missed before the last step tells what is missed after it: its square.
        close = (missed < 1e-14 * (1.0 + d2)) & (p * p + q * q <= 1.05 * m.p2_max)
        return where(d2 <= m.d2_max, p, np.nan), q, close | (d2 > m.d2_max)

    @staticmethod
    def first_steps(m: Any, p: Any, q: Any, x: Any, y: Any) -> Any:
        """Give `inverse_step` repeated as often as it is for every point."""
        # Written out, not in a loop: so the compiled loop over the points vectorises.
        p, q, _ = inverse_step(m, p, q, x, y)
        p, q, _ = inverse_step(m, p, q, x, y)
        p, q, _ = inverse_step(m, p, q, x, y)
        p, q, _ = inverse_step(m, p, q, x, y)
        return inverse_step(m, p, q, x, y)

    @staticmethod
    def inverse_step(m: Any, p: Any, q: Any, x: Any, y: Any) -> Any:
        """Give (p, q) after a Newton step towards `distort` = (x, y), and what was missed before it, squared.

        That is about what the step leaves: near a fold more than its square, by the determinant that vanishes there.
        """
        dx, dy = distort(m, p, q)
        dx, dy = dx - x, dy - y
        xx, xy, yx, yy = distort_jacobian(m, p, q)
        over = 1.0 / (xx * yy - xy * yx)
        beyond = dx * dx + dy * dy - ROUNDED * (1.0 + x * x + y * y)
        missed = where(beyond > 0.0, beyond, 0.0) * where(np.abs(over) > 1.0, np.abs(over * over * over), 1.0)
        return p - (yy * dx - xy * dy) * over, q - (xx * dy - yx * dx) * over, missed

    def derived_back(self) -> dict[str, Any]:
        azimuth = np.linspace(0, 2 * np.pi, 32, endpoint=False)
        radius = self.disc
        x, y = self.distort(self, radius * np.cos(azimuth), radius * np.sin(azimuth))
        return {**super().derived_back(), "d2_max": 1.05 * float((x * x + y * y).max()), "p2_max": radius**2}

    def radial_fold(self) -> float:
        """Give the radius at which the radial part alone stops growing."""
        return np.inf

    def plane_radius_max(self) -> float:
        return self.radius_before_fold(min(self.radial_fold() * (1 - FOLD_MARGIN), self.radius_max(), FARTHEST))

    def radius_before_fold(self, radius: float) -> float:
        """Give the radius, at most that one, of the disc in which the plane does not fold."""
        # Where the parts that are not radial are strong, the plane folds before the radial part does.
        shares = SHARES
        low = 0.0
        for _ in range(CLOSER):
            least = self._least_area(radius * shares)
            folded = np.flatnonzero(least <= 0)
            if not len(folded):
                return radius
            first = folded[0]
            low, high = shares[first - 1] if first else low, shares[first]
            shares = np.linspace(low, high, 17)[1:]
        return float(radius * low * (1 - FOLD_MARGIN - AROUND_MARGIN * (1 - low)))

    def _least_area(self, radii: Array) -> Array:
        """Give what areas of the plane are magnified by, the least on each circle."""
        xx, xy, yx, yy = self.distort_jacobian(self, radii[:, None] * CIRCLE[0], radii[:, None] * CIRCLE[1])
        return np.min(xx * yy - xy * yx, axis=1)


def first_positive_root(coefficients: Sequence[float]) -> float:
    """Give the smallest positive root of a polynomial, coefficients from the constant up; inf if none."""
    return float(positive_roots(coefficients).min(initial=np.inf))


def positive_roots(coefficients: Sequence[float]) -> Array:
    """Give the positive roots of a polynomial, coefficients from the constant up."""
    degree = len(coefficients) - 1
    while degree > 0 and coefficients[degree] == 0:
        degree -= 1
    if degree < 1:
        return np.empty(0)
    if degree == 1:
        return np.array([root] if (root := -coefficients[0] / coefficients[1]) > 0 else [])
    companion = np.eye(degree, k=-1)
    companion[0] -= np.array(coefficients[degree - 1 :: -1]) / coefficients[degree]
    roots = np.linalg.eigvals(companion)
    real = (np.abs(roots.imag) < 1e-9 * (1 + np.abs(roots))) & (roots.real > 0)
    return np.asarray(roots.real[real], float)


class Radial(Distorted):
    """A distortion with a radial part."""

    def growth(self) -> list[float]:
        """Give the slope of the radial part, or what has its sign, as a polynomial of r^2: coefficients from 1 up."""
        raise NotImplementedError

    def radial_fold(self) -> float:
        return first_positive_root(self.growth()) ** 0.5


class RadialTangential(Radial):
    """Brown's distortion with coefficients k1, k2 (radial) and p1, p2 (decentring).

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
        return {"k1": (x * r2, y * r2), "k2": (x * r2**2, y * r2**2)} | decentring_partials(x, y)

    def growth(self) -> list[float]:
        return [1.0, 3 * self.k1, 5 * self.k2]

    def radius_before_fold(self, radius: float) -> float:
        # The eigenvalues of the Jacobian, without decentring the radial part and its slope, are moved by at most
        # 6 |p| r (Weyl): mostly that alone tells that nothing folds.
        least = min(least_value(*terms, end=radius**2) for terms in ([1.0, self.k1, self.k2], self.growth()))
        if least > 6 * np.hypot(self.p1, self.p2) * radius:
            return radius
        return super().radius_before_fold(radius)


def least_value(a: float, b: float, c: float, end: float) -> float:
    """Give the least value of a + b q + c q^2 from 0 to the end."""
    lowest = -b / (2 * c) if c > 0 else 0.0
    return min(a + q * (b + q * c) for q in (0.0, min(max(lowest, 0.0), end), end))


def decentring_partials(x: Array, y: Array) -> dict[str, tuple[Partial, Partial]]:
    """Give the derivatives by p1 and p2."""
    r2 = x * x + y * y
    return {"p1": (2 * x * y, r2 + 2 * y * y), "p2": (r2 + 2 * x * x, 2 * x * y)}


class Rational(Radial):
    """OpenCV's rational distortion with k1 ... k6 and p1, p2; coefficients that a model lacks are 0."""

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
        over = 1.0 / (1.0 + r2 * (m.k4 + r2 * (m.k5 + r2 * m.k6)))
        radial = (1.0 + r2 * (m.k1 + r2 * (m.k2 + r2 * m.k3))) * over
        slope = m.k1 + r2 * (2.0 * m.k2 + r2 * 3.0 * m.k3)
        slope = 2.0 * over * (slope - radial * (m.k4 + r2 * (2.0 * m.k5 + r2 * 3.0 * m.k6)))
        cross = x * y * slope + 2.0 * (m.p1 * x + m.p2 * y)
        xx = radial + x * x * slope + 2.0 * m.p1 * y + 6.0 * m.p2 * x
        yy = radial + y * y * slope + 6.0 * m.p1 * y + 2.0 * m.p2 * x
        return xx, cross, cross, yy

    def distort_partials(self, x: Array, y: Array) -> dict[str, tuple[Partial, Partial]]:
        r2 = x * x + y * y
        over = 1.0 / (1.0 + r2 * (self.k4 + r2 * (self.k5 + r2 * self.k6)))
        radial = (1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))) * over
        above = {f"k{i}": r2**i * over for i in (1, 2, 3)}
        below = {f"k{i + 3}": -radial * r2**i * over for i in (1, 2, 3)}
        partials = {name: (x * d, y * d) for name, d in (above | below).items()}
        return partials | decentring_partials(x, y)

    def growth(self) -> list[float]:
        # d/dr [r N/D] D^2 with N, D polynomials in q = r^2:  (N + 2 q N') D - 2 q N D'.
        n, d = (1.0, self.k1, self.k2, self.k3), (1.0, self.k4, self.k5, self.k6)
        terms = [0.0] * 7
        for i, j in itertools.product(range(4), range(4)):
            terms[i + j] += (1 + 2 * i - 2 * j) * n[i] * d[j]
        return terms
