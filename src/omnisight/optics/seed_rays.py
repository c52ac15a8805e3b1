"""Starting points for the search of reflection points: rays traced in advance."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.optics.placed_mirror import PlacedMirror
from omnisight.optics.reflection import reflect

Array = NDArray[np.float64]

# Point-ray pairs compared at a time: the arrays stay in the cache.
BLOCK_PAIRS = 1 << 16


@dataclass(frozen=True)
class SeedRays:
    """Rays of a lens over its mirrors that sample the whole first mirror.

    Attributes
    ----------
    u
        (2 m, K) intersections with the m mirrors, each pair in the chart of its mirror.
    origins, bearings
        (K, 3) as the rays leave the last mirror, in the lens frame. NaN for rays that miss a mirror.
    origin_gap, bearing_gap
        (K,) largest difference between the origins (bearings) of a ray and of its neighbours.
    spokes
        Number of rays in each ring; rays are ordered by ring.
    """

    u: Array
    origins: Array
    bearings: Array
    origin_gap: Array
    bearing_gap: Array
    spokes: int

    @classmethod
    def trace(cls, placed: Sequence[PlacedMirror], parallel: bool, rings: int, spokes: int) -> Self:
        """Trace rays to rings of points on the first mirror."""
        mirror, pose = placed[0].mirror, placed[0].lens_from_mirror
        share = np.append((np.arange(rings - 1) + 0.5) / (rings - 1), 1.0)
        if np.isfinite(mirror.rim):
            rho = mirror.hole + (mirror.rim - mirror.hole) * share
        else:
            rho = mirror.hole + float(np.linalg.norm(pose.translation)) * share / (1.1 - share)
        phi = 2 * np.pi * (np.arange(spokes) + 0.5 * (np.arange(rings) % 2)[:, None]) / spokes
        x, y = (rho[:, None] * np.cos(phi)).ravel(), (rho[:, None] * np.sin(phi)).ravel()
        with np.errstate(all="ignore"):
            at = np.stack([x, y, mirror.sag(np.hypot(x, y))], -1)
            corner = pose @ at
            d = np.broadcast_to([0.0, 0.0, 1.0], corner.shape) if parallel else corner
            d = d / np.sqrt((d * d).sum(-1, keepdims=True))
            normal = mirror.normal(at) @ pose.rotation.T
            use = (d * normal).sum(-1) < 0
            u, bearings = [*mirror.chart_coordinates(x, y)], reflect(d, normal)
            for p in placed[1:]:
                pose = p.lens_from_mirror
                o, d = (corner - pose.translation) @ pose.rotation, bearings @ pose.rotation
                distance, hit = p.mirror.intersect(o, d)
                use &= hit
                at = o + distance[:, None] * d
                u += p.mirror.chart_coordinates(at[:, 0], at[:, 1])
                corner = pose @ at
                bearings = reflect(d, p.mirror.normal(at)) @ pose.rotation.T
            use &= np.isfinite(bearings).all(-1)
            corner[~use] = bearings[~use] = np.nan
            origin_gap, bearing_gap = (_neighbour_gaps(a, rings, spokes) for a in (corner, bearings))
            if not np.isfinite(mirror.rim):
                bearing_gap[-spokes:] = np.inf  # an unbounded mirror continues beyond the last ring
        return cls(np.stack(u), corner, bearings, origin_gap, bearing_gap, spokes)

    def nearest(self, points: Array, count: int) -> tuple[Array, NDArray[np.bool_]]:
        """Return candidate rays for points (N, 3) and whether each is close enough, both (count + 1, N).

        The candidates are the `count` best local maxima of the alignment between ray and point, and the ray whose
        origin is nearest to the point. A candidate is close enough if the point is within its distance to its
        neighbours; duplicates of the first candidate are not. If no candidate is close enough, the mirrors do not show
        the point.
        """
        which = np.zeros((count + 1, len(points)), int)
        near = np.zeros(which.shape, np.bool_)
        used = np.flatnonzero(np.isfinite(self.bearings[:, 0]))
        if not len(used):
            return which, near
        o, b = self.origins[used], self.bearings[used]
        ob, oo = (o * b).sum(-1), (o * o).sum(-1)
        step = max(1, BLOCK_PAIRS // len(self.bearing_gap))
        for first in range(0, len(points), step):
            part = slice(first, first + step)
            x = points[part]
            # In rank, because these are the largest arrays.
            along, distance2 = x @ b.T, x @ (-2 * o.T)
            along -= ob
            distance2 += (x * x).sum(-1, keepdims=True)
            distance2 += oo
            np.maximum(distance2, 1e-300, out=distance2)
            score = np.abs(along)
            score *= along
            score /= distance2
            peaks = used[np.argmax(score, -1)][None] if count == 1 else self._peaks(score, used, count)
            best = np.concatenate([peaks, used[np.argmin(distance2, -1)][None]])
            which[:, part] = best
            off = x - self.origins[best]
            length = np.sqrt((off * off).sum(-1))
            angle = np.sqrt(((off / length[..., None] - self.bearings[best]) ** 2).sum(-1))
            near[:, part] = angle <= 2 * (self.bearing_gap[best] + self.origin_gap[best] / length)
            near[1:, part] &= best[1:] != best[0]
        return which, near

    def _peaks(self, score: Array, used: NDArray[np.intp], count: int) -> NDArray[np.intp]:
        """Return the rays (count, N) at score maxima (N, len(used)), highest first, padded by the first."""
        grid = np.full((len(score), len(self.bearing_gap)), -np.inf)
        grid[:, used] = score
        grid = grid.reshape(len(score), -1, self.spokes)
        peak = (grid >= np.roll(grid, 1, 2)) & (grid >= np.roll(grid, -1, 2))
        peak[:, 1:] &= grid[:, 1:] >= grid[:, :-1]
        peak[:, :-1] &= grid[:, :-1] >= grid[:, 1:]
        # Sort only the few peaks, by point and then by score.
        point, ray = np.nonzero((peak & (grid > -np.inf)).reshape(len(score), -1))
        order = np.lexsort((-grid.reshape(len(score), -1)[point, ray], point))
        point, ray = point[order], ray[order]
        rank = np.arange(len(point)) - np.searchsorted(point, point)
        first = np.searchsorted(point, np.arange(len(score)))
        best = np.repeat(ray[first][None], count, 0)
        best[rank[rank < count], point[rank < count]] = ray[rank < count]
        return best


def _neighbour_gaps(values: Array, rings: int, spokes: int) -> Array:
    """Return the largest distance (K,) of values (K, 3) from those in the adjacent rings and spokes."""
    grid = values.reshape(rings, spokes, 3)
    largest = np.zeros((rings, spokes))
    for axis in (0, 1):
        for shift in (1, -1):
            neighbour = np.roll(grid, shift, axis)
            if axis == 0:
                neighbour[0 if shift == 1 else -1] = np.nan
            largest = np.fmax(largest, np.sqrt(((neighbour - grid) ** 2).sum(-1)))
    return largest.ravel()
