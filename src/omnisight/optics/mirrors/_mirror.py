"""What every mirror gives: its surface from a profile, and where rays meet it."""

from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.models._parameter import parameter
from omnisight.models._parametric import Parametric
from omnisight.models._protocol import rows

Array = NDArray[np.float64]

# Steps towards the surface, after which a ray that keeps grazing it is said to miss.
STEPS = 200


def outer_rim() -> Any:
    """Declare the distance from the axis at which a mirror ends."""
    return parameter("distance of the rim from the axis", unit="m", low=0.0, default=np.inf, free=False)


def inner_rim() -> Any:
    """Declare the distance from the axis within which a mirror has a hole."""
    return parameter("radius of the hole in the middle", unit="m", low=0.0, default=0.0, free=False)


class Mirror(Parametric):
    """A mirror of revolution.

    A subclass is a frozen dataclass whose fields are its parameters, `rim` and `hole` the last. It writes `profile`,
    and `first` if it knows better than to step along rays. Lengths are metres, or all of another unit.
    """

    rim: float
    hole: float

    def __post_init__(self) -> None:
        """Refuse a mirror of which there is nothing."""
        if not self.rim > self.hole >= 0:
            raise ValueError(
                f"a mirror lies between its hole and its rim: 0 <= hole < rim, got {self.hole}, {self.rim}"
            )

    # -- what a mirror writes -----------------------------------------------------------------------------------

    def profile(self, w: Array) -> tuple[Array, Array, Array]:
        """Give the sag s and its derivatives ds/dw and d2s/dw2, as functions of w = rho^2; NaN where there is none."""
        raise NotImplementedError

    @property
    def convex(self) -> bool:
        """Whether what lies behind the surface is convex: no ray that leaves such a mirror meets it again."""
        return bool(self.curvature_bounds[0] >= 0)

    @classmethod
    def example(cls) -> Self:
        """Give a typical mirror of this shape, for tests and docs."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """Give the parameters by name, without the rim of an endless mirror."""
        return {name: value for name, value in super().to_dict().items() if np.isfinite(value)}

    # -- the surface --------------------------------------------------------------------------------------------

    def sag(self, rho: ArrayLike) -> Array:
        """Give how far (...) the surface lies behind its vertex at the distances rho (...) from the axis."""
        with np.errstate(all="ignore"):
            return self.profile(np.asarray(rho, float) ** 2)[0]

    def normal(self, points: ArrayLike) -> Array:
        """Give the unit normals (..., 3) at points (..., 3) of the surface, towards the side that reflects.

        Only their x and y are looked at: the normal is that of the surface at this distance from the axis.
        """
        p = np.asarray(points, float)
        x, y = p[..., 0], p[..., 1]
        with np.errstate(all="ignore"):
            twice = 2 * self.profile(x * x + y * y)[1]
            n = np.stack([twice * x, twice * y, np.full_like(x, -1.0)], -1)
            return n / np.sqrt((n * n).sum(-1, keepdims=True))

    # -- the chart: where light meets the mirror is searched for in it --------------------------------------------

    def chart(self, w: Array) -> tuple[tuple[Array, Array, Array], tuple[Array, Array, Array]]:
        """Give A and B, each with two derivatives, of the chart (x, y, z) = (a A(w), b A(w), B(w)), w = a^2 + b^2.

        Unless a mirror has a smoother one, it is (x, y, z) = (a, b, s).
        """
        one, zero = np.ones_like(w), np.zeros_like(w)
        return (one, zero, zero), self.profile(w)

    def chart_coordinates(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Give the place in the chart of the point of the mirror at x, y."""
        return x, y

    def surface(self, a: Array, b: Array) -> tuple[Array, Array, Array]:
        """Give the point (3, N) at a place of the chart, its derivatives by a, b (2, 3, N) and aa, ab, bb (3, 3, N)."""
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
        """Say whether a place of the chart is on the mirror's sheet of the surface, which goes on past rim and hole."""
        x, y, _ = self.surface(a, b)[0]
        back_a, back_b = self.chart_coordinates(x, y)
        return np.abs(back_a - a) + np.abs(back_b - b) <= 1e-6 * (np.abs(a) + np.abs(b))

    def has(self, a: Array, b: Array) -> NDArray[np.bool_]:
        """Say whether a place of the chart is a point of the mirror."""
        x, y, _ = self.surface(a, b)[0]
        return self.on_sheet(a, b) & self.is_within_rim(x * x + y * y)

    # -- where it ends --------------------------------------------------------------------------------------------

    def within(self, w: Array) -> NDArray[np.bool_]:
        """Say whether w = rho^2 lies between the hole and the rim."""
        return (w <= self.rim**2 * (1 + 1e-14)) & (w >= self.hole**2 * (1 - 1e-14))

    # -- rays ---------------------------------------------------------------------------------------------------

    def intersect(self, origins: ArrayLike, bearings: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Give where rays meet the mirror.

        Parameters
        ----------
        origins, bearings
            (..., 3) in the mirror's frame; bearings of unit length.

        Returns
        -------
        distance
            (...) along the ray to where it first meets the mirror; NaN where not valid.
        valid
            (...), whether it does, and on the side that reflects.
        """
        o, lead = rows(origins, 3, "origins")
        d, _ = rows(bearings, 3, "bearings")
        with np.errstate(all="ignore"):
            distance = self.first_intersection(o, d)
            at = o + distance[:, None] * d
            # From the side that reflects.
            valid = np.isfinite(distance) & ((d * self.normal(at)).sum(-1) < 0)
        return np.where(valid, distance, np.nan).reshape(lead), valid.reshape(lead)

    def first(self, origins: Array, bearings: Array) -> Array:
        """Give the distances (N,) at which rays (N, 3) first meet the mirror, from either side; inf where they do not.

        With f = z - s(rho) along the ray and bounds on its second derivative by the curvature of the profile, no step
        passes a root, and near one they are Newton's.
        """
        inf = np.full(len(origins), np.inf)
        least, most = self.curvature_bounds
        across = (bearings[:, :2] ** 2).sum(-1)
        # Between these distances the ray is nearer to the axis than the rim, and as high as the surface is.
        along = (origins[:, :2] * bearings[:, :2]).sum(-1)
        off = (origins[:, :2] ** 2).sum(-1) - self.rim**2
        root = np.sqrt(along * along - across * off)
        level = across == 0
        enter = np.where(level, np.where(off <= 0, -inf, inf), (-along - root) / across)
        leave = np.where(level, inf, (-along + root) / across)
        low, high = (
            (z + np.array([[-1.0], [1.0]]) * 1e-9 * (abs(z) + self.rim) - origins[:, 2]) / bearings[:, 2]
            for z in self.sag_bounds
        )
        slab = np.sort(np.stack([low[0], high[1]]), 0)
        flat = bearings[:, 2] == 0
        enter = np.fmax(np.fmax(enter, np.where(flat, -inf, slab[0])), 0.0)
        leave = np.fmin(leave, np.where(flat, inf, slab[1]))
        found, t = inf.copy(), enter.copy()
        rest = np.flatnonzero((enter <= leave) & np.isfinite(enter))
        for _ in range(STEPS):
            if not len(rest):
                break
            o, d = origins[rest], bearings[rest]
            at = o + t[rest, None] * d
            w = at[:, 0] ** 2 + at[:, 1] ** 2
            s, ds, _ = self.profile(np.minimum(w, self.rim**2))
            f = at[:, 2] - s
            df = d[:, 2] - 2 * ds * (at[:, 0] * d[:, 0] + at[:, 1] * d[:, 1])
            towards = np.where(f < 0, df, -df)
            bend = np.maximum(np.where(f < 0, -least, most), 0.0) * across[rest]
            # The nearest place at which f may vanish; each form where it does not cancel.
            root = np.sqrt(towards**2 + 2 * bend * np.abs(f))
            step = np.where(towards > 0, 2 * np.abs(f) / (towards + root), (root - towards) / bend)
            # On the surface but for rounding, which may have put it on either side.
            there = np.abs(f) <= 1e-15 * (t[rest] + np.abs(o).max(-1))
            t[rest] += np.where(there, -f / df, np.where(np.isnan(step), np.inf, step))
            there &= w <= self.rim**2 * (1 + 1e-14)
            through = there & (w < self.hole**2)
            found[rest[there & ~through]] = t[rest[there & ~through]]
            # Through the hole: go on behind it.
            t[rest[through]] += 1e-9 * self.rim
            rest = rest[(~there | through) & (t[rest] <= leave[rest] * (1 + 1e-14))]
        return found

    @cached_property
    def curvatures(self) -> tuple[float, float]:
        """Give bounds of the second derivatives of the sag by x and y within the rim: the least and the most."""
        w = (self.rim * np.linspace(0, 1, 1025)) ** 2
        _, ds, dds = self.profile(w)
        bends = np.concatenate([2 * ds, 2 * ds + 4 * w * dds])
        slack = 1e-4 * float(np.ptp(bends))
        least, most = float(bends.min()), float(bends.max())
        return (least - slack if least < 0 else least), (most + slack if most > 0 else most)

    @cached_property
    def heights(self) -> tuple[float, float]:
        """Give the least and the largest sag within the rim."""
        s = self.sag(self.rim * np.linspace(0, 1, 1025))
        slack = 1e-4 * float(np.ptp(s))
        return float(s.min()) - slack, float(s.max()) + slack

    def clear(self, origins: Array, bearings: Array, lengths: Array) -> NDArray[np.bool_]:
        """Say which rays (N, 3) do not meet the mirror before that length (N,), after where they begin."""
        off = 1e-9 * (np.abs(origins).max(-1) + (self.rim if np.isfinite(self.rim) else 0.0))
        return self.first_intersection(origins + off[:, None] * bearings, bearings) >= (lengths - off) * (1 - 1e-9)
