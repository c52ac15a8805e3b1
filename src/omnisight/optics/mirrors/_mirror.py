"""The base class of mirrors: a surface of revolution from its profile, and its intersection with rays."""

from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.models._arrays import as_rows
from omnisight.models._parameter import parameter
from omnisight.models._parameterized import Parameterized

Array = NDArray[np.float64]

# Steps towards the surface, after which a grazing ray counts as a miss.
MAX_STEPS = 200
# Relative tolerance of the rim, for rounding of rho^2.
RIM_TOLERANCE = 1e-14
# Samples of the profile that bound its sag and curvature.
PROFILE_SAMPLES = 1025


def outer_rim() -> Any:
    """Declare the radius of a mirror."""
    return parameter("distance of the rim from the axis", unit="m", low=0.0, default=np.inf, free=False)


def inner_rim() -> Any:
    """Declare the radius of the hole around the axis of a mirror."""
    return parameter("radius of the central hole", unit="m", low=0.0, default=0.0, free=False)


class Mirror(Parameterized):
    """A mirror of revolution.

    A subclass is a frozen dataclass whose fields are its parameters; `rim` and `hole` are the last. It implements
    `profile`, and `first_intersection` if there is a closed form. Lengths are in metres or any other single unit.
    """

    rim: float
    hole: float

    def __post_init__(self) -> None:
        """Check that the rim is larger than the hole."""
        if not self.rim > self.hole >= 0:
            raise ValueError(f"a mirror needs 0 <= hole < rim, got hole {self.hole} and rim {self.rim}")

    # -- to be implemented by a mirror ----------------------------------------------------------------------------

    def profile(self, w: Array) -> tuple[Array, Array, Array]:
        """Return the sag s, ds/dw and d2s/dw2 as functions of w = rho^2; NaN where undefined."""
        raise NotImplementedError

    @property
    def convex(self) -> bool:
        """Whether the body behind the surface is convex: a reflected ray then never meets the mirror again."""
        return bool(self.curvature_bounds[0] >= 0)

    @classmethod
    def example(cls) -> Self:
        """Return a typical mirror of this shape, for tests and docs."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """Return the parameters by name, without an infinite rim."""
        return {name: value for name, value in super().to_dict().items() if np.isfinite(value)}

    # -- the surface --------------------------------------------------------------------------------------------

    def sag(self, rho: ArrayLike) -> Array:
        """Return the height (...) of the surface behind its vertex at distances rho (...) from the axis."""
        with np.errstate(all="ignore"):
            return self.profile(np.asarray(rho, float) ** 2)[0]

    def normal(self, points: ArrayLike) -> Array:
        """Return the unit normals (..., 3) at points (..., 3) of the surface, towards the reflecting side.

        Only x and y of the points are used.
        """
        p = np.asarray(points, float)
        x, y = p[..., 0], p[..., 1]
        with np.errstate(all="ignore"):
            twice = 2 * self.profile(x * x + y * y)[1]
            n = np.stack([twice * x, twice * y, np.full_like(x, -1.0)], -1)
            return n / np.sqrt((n * n).sum(-1, keepdims=True))

    # -- the chart (surface coordinates) in which reflection points are computed ------------------------------------

    def chart(self, w: Array) -> tuple[tuple[Array, Array, Array], tuple[Array, Array, Array]]:
        """Return A and B, each with two derivatives by w, of the chart (x, y, z) = (a A, b A, B), w = a^2 + b^2.

        The default is (x, y, z) = (a, b, s). A mirror may override it by a smoother one.
        """
        one, zero = np.ones_like(w), np.zeros_like(w)
        return (one, zero, zero), self.profile(w)

    def chart_coordinates(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Return the chart coordinates (a, b) of the mirror's point at x, y."""
        return x, y

    def surface(self, a: Array, b: Array) -> tuple[Array, Array, Array]:
        """Return points (3, N) at chart coordinates, with derivatives by a, b (2, 3, N) and aa, ab, bb (3, 3, N)."""
        (f, df, ddf), (z, dz, ddz) = self.chart(a * a + b * b)
        cross, slope = 2 * a * b * df, 2 * dz
        d_a = np.stack([f + 2 * a * a * df, cross, a * slope])
        d_b = np.stack([cross, f + 2 * b * b * df, b * slope])
        fa, fb = 2 * df + 4 * a * a * ddf, 2 * df + 4 * b * b * ddf
        d_aa = np.stack([a * (4 * df + fa), b * fa, slope + 4 * a * a * ddz])
        d_ab = np.stack([b * fa, a * fb, 4 * a * b * ddz])
        d_bb = np.stack([a * fb, b * (4 * df + fb), slope + 4 * b * b * ddz])
        return np.stack([a * f, b * f, z]), np.stack([d_a, d_b]), np.stack([d_aa, d_ab, d_bb])

    def on_sheet(self, a: Array, b: Array) -> NDArray[np.bool_]:
        """Return whether chart coordinates are on the mirror's sheet of the surface, ignoring rim and hole."""
        x, y, _ = self.surface(a, b)[0]
        back_a, back_b = self.chart_coordinates(x, y)
        return np.abs(back_a - a) + np.abs(back_b - b) <= 1e-6 * (np.abs(a) + np.abs(b))

    def contains(self, a: Array, b: Array) -> NDArray[np.bool_]:
        """Return whether chart coordinates are a point of the mirror."""
        x, y, _ = self.surface(a, b)[0]
        return self.on_sheet(a, b) & self.is_within_rim(x * x + y * y)

    def is_within_rim(self, w: Array) -> NDArray[np.bool_]:
        """Return whether w = rho^2 lies between the hole and the rim."""
        return (w <= self.rim**2 * (1 + RIM_TOLERANCE)) & (w >= self.hole**2 * (1 - RIM_TOLERANCE))

    # -- rays ---------------------------------------------------------------------------------------------------

    def intersect(self, origins: ArrayLike, bearings: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Intersect rays with the mirror.

        Parameters
        ----------
        origins, bearings
            (..., 3) in the mirror frame; bearings of unit length.

        Returns
        -------
        distance
            (...) along the ray to the first intersection; NaN where not valid.
        valid
            (...), whether the ray meets the mirror on its reflecting side.
        """
        o, lead = as_rows(origins, 3, "origins")
        d, _ = as_rows(bearings, 3, "bearings")
        with np.errstate(all="ignore"):
            distance = self.first_intersection(o, d)
            at = o + distance[:, None] * d
            valid = np.isfinite(distance) & ((d * self.normal(at)).sum(-1) < 0)
        return np.where(valid, distance, np.nan).reshape(lead), valid.reshape(lead)

    def first_intersection(self, origins: Array, bearings: Array) -> Array:
        """Return the distances (N,) at which rays (N, 3) first meet the mirror from either side; inf if they miss.

        Bounds on the curvature of the profile bound the second derivative of f = z - s(rho) along the ray. The
        resulting steps never pass a root and become Newton steps close to it.
        """
        low_curvature, high_curvature = self.curvature_bounds
        across = (bearings[:, :2] ** 2).sum(-1)
        enter, leave = self._cylinder_interval(origins, bearings)
        distance, t = np.full(len(origins), np.inf), enter.copy()
        active = np.flatnonzero((enter <= leave) & np.isfinite(enter))
        for _ in range(MAX_STEPS):
            if not len(active):
                break
            o, d = origins[active], bearings[active]
            at = o + t[active, None] * d
            w = at[:, 0] ** 2 + at[:, 1] ** 2
            s, ds, _ = self.profile(np.minimum(w, self.rim**2))
            f = at[:, 2] - s
            df = d[:, 2] - 2 * ds * (at[:, 0] * d[:, 0] + at[:, 1] * d[:, 1])
            towards = np.where(f < 0, df, -df)
            bend = np.maximum(np.where(f < 0, -low_curvature, high_curvature), 0.0) * across[active]
            # The smallest step at which f can vanish, in the form that does not cancel.
            root = np.sqrt(towards**2 + 2 * bend * np.abs(f))
            step = np.where(towards > 0, 2 * np.abs(f) / (towards + root), (root - towards) / bend)
            # On the surface up to rounding, possibly on the other side.
            hit = np.abs(f) <= 1e-15 * (t[active] + np.abs(o).max(-1))
            t[active] += np.where(hit, -f / df, np.where(np.isnan(step), np.inf, step))
            hit &= w <= self.rim**2 * (1 + RIM_TOLERANCE)
            in_hole = hit & (w < self.hole**2)
            distance[active[hit & ~in_hole]] = t[active[hit & ~in_hole]]
            # Continue behind the hole.
            t[active[in_hole]] += 1e-9 * self.rim
            active = active[(~hit | in_hole) & (t[active] <= leave[active] * (1 + RIM_TOLERANCE))]
        return distance

    def _cylinder_interval(self, origins: Array, bearings: Array) -> tuple[Array, Array]:
        """Return the distances (N,) between which rays are inside the cylinder that bounds the mirror."""
        inf = np.full(len(origins), np.inf)
        across = (bearings[:, :2] ** 2).sum(-1)
        along = (origins[:, :2] * bearings[:, :2]).sum(-1)
        outside = (origins[:, :2] ** 2).sum(-1) - self.rim**2
        root = np.sqrt(along * along - across * outside)
        axial = across == 0
        enter = np.where(axial, np.where(outside <= 0, -inf, inf), (-along - root) / across)
        leave = np.where(axial, inf, (-along + root) / across)
        low, high = (
            (z + np.array([[-1.0], [1.0]]) * 1e-9 * (abs(z) + self.rim) - origins[:, 2]) / bearings[:, 2]
            for z in self.sag_bounds
        )
        slab = np.sort(np.stack([low[0], high[1]]), 0)
        level = bearings[:, 2] == 0
        enter = np.fmax(np.fmax(enter, np.where(level, -inf, slab[0])), 0.0)
        return enter, np.fmin(leave, np.where(level, inf, slab[1]))

    @cached_property
    def curvature_bounds(self) -> tuple[float, float]:
        """Lower and upper bound of the second derivatives of the sag by x and y within the rim."""
        w = (self.rim * np.linspace(0, 1, PROFILE_SAMPLES)) ** 2
        _, ds, dds = self.profile(w)
        bends = np.concatenate([2 * ds, 2 * ds + 4 * w * dds])
        slack = 1e-4 * float(np.ptp(bends))
        low, high = float(bends.min()), float(bends.max())
        return (low - slack if low < 0 else low), (high + slack if high > 0 else high)

    @cached_property
    def sag_bounds(self) -> tuple[float, float]:
        """Lower and upper bound of the sag within the rim."""
        s = self.sag(self.rim * np.linspace(0, 1, PROFILE_SAMPLES))
        slack = 1e-4 * float(np.ptp(s))
        return float(s.min()) - slack, float(s.max()) + slack

    def is_unobstructed(self, origins: Array, bearings: Array, lengths: Array) -> NDArray[np.bool_]:
        """Return which rays (N, 3) do not meet the mirror between their start and a length (N,)."""
        off = 1e-9 * (np.abs(origins).max(-1) + (self.rim if np.isfinite(self.rim) else 0.0))
        return self.first_intersection(origins + off[:, None] * bearings, bearings) >= (lengths - off) * (1 - 1e-9)
