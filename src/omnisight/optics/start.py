"""Where to begin the search for a reflection point: rays followed beforehand."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.optics.placed import Placed
from omnisight.optics.reflection import reflect

Array = NDArray[np.float64]

# How many numbers are compared at a time.
BLOCK = 1 << 16


@dataclass(frozen=True)
class Seeds:
    """Rays of a lens over its mirrors, spread over all of the first.

    Attributes
    ----------
    u
        (2 m, K) where they meet the mirrors, each pair in the chart of its mirror.
    origins, bearings
        (K, 3) how they leave the last one, in the lens's frame.
    apart, turn
        (K,) how far the origins and bearings of neighbours differ.
    spokes
        How many of them, in order, are in each ring. Those that no light takes are NaN.
    """

    u: Array
    origins: Array
    bearings: Array
    apart: Array
    turn: Array
    spokes: int

    @classmethod
    def of(cls, placed: Sequence[Placed], parallel: bool, rings: int, spokes: int) -> Self:
        """Follow rays to so many rings of points on the first mirror."""
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
            u, bearings = [*mirror.charted(x, y)], reflect(d, normal)
            for p in placed[1:]:
                pose = p.lens_from_mirror
                o, d = (corner - pose.translation) @ pose.rotation, bearings @ pose.rotation
                distance, hit = p.mirror.intersect(o, d)
                use &= hit
                at = o + distance[:, None] * d
                u += p.mirror.charted(at[:, 0], at[:, 1])
                corner = pose @ at
                bearings = reflect(d, p.mirror.normal(at)) @ pose.rotation.T
            use &= np.isfinite(bearings).all(-1)
            corner[~use] = bearings[~use] = np.nan
            apart, turn = (_neighbours(a, rings, spokes) for a in (corner, bearings))
            if not np.isfinite(mirror.rim):
                turn[-spokes:] = np.inf  # nothing is beyond an endless mirror's last ring
        return cls(np.stack(u), corner, bearings, apart, turn, spokes)

    def nearest(self, points: Array, count: int) -> tuple[Array, NDArray[np.bool_]]:
        """Give rays to begin from for points (N, 3), and whether they may be near enough, both (count + 1, N).

        They are those that point best at it, each better than the rays around it, and the one that leaves the mirror
        nearest to it. None is near enough if the point lies farther off it than its neighbours do, nor is one that is
        the first again; if none of them is, the mirrors do not show the point.
        """
        which = np.zeros((count + 1, len(points)), int)
        near = np.zeros(which.shape, np.bool_)
        used = np.flatnonzero(np.isfinite(self.bearings[:, 0]))
        if not len(used):
            return which, near
        o, b = self.origins[used], self.bearings[used]
        ob, oo = (o * b).sum(-1), (o * o).sum(-1)
        step = max(1, BLOCK // len(self.turn))
        for first in range(0, len(points), step):
            part = slice(first, first + step)
            x = points[part]
            # In place: these are the largest arrays here.
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
            near[:, part] = angle <= 2 * (self.turn[best] + self.apart[best] / length)
            near[1:, part] &= best[1:] != best[0]
        return which, near

    def _peaks(self, score: Array, used: NDArray[np.intp], count: int) -> NDArray[np.intp]:
        """Give the rays (count, N) whose score (N, len(used)) is no less than their neighbours', the highest first.

        Where there are fewer, the first again.
        """
        grid = np.full((len(score), len(self.turn)), -np.inf)
        grid[:, used] = score
        grid = grid.reshape(len(score), -1, self.spokes)
        peak = (grid >= np.roll(grid, 1, 2)) & (grid >= np.roll(grid, -1, 2))
        peak[:, 1:] &= grid[:, 1:] >= grid[:, :-1]
        peak[:, :-1] &= grid[:, :-1] >= grid[:, 1:]
        # Peaks are few: what is sorted is them, by point and then by score.
        point, ray = np.nonzero((peak & (grid > -np.inf)).reshape(len(score), -1))
        order = np.lexsort((-grid.reshape(len(score), -1)[point, ray], point))
        point, ray = point[order], ray[order]
        place = np.arange(len(point)) - np.searchsorted(point, point)
        first = np.searchsorted(point, np.arange(len(score)))
        best = np.repeat(ray[first][None], count, 0)
        best[place[place < count], point[place < count]] = ray[place < count]
        return best


def _neighbours(values: Array, rings: int, spokes: int) -> Array:
    """Give the largest difference (K,) of the values (K, 3) to those of the next ring and the next spokes."""
    grid = values.reshape(rings, spokes, 3)
    largest = np.zeros((rings, spokes))
    for axis in (0, 1):
        for way in (1, -1):
            beside = np.roll(grid, way, axis)
            if axis == 0:
                beside[0 if way == 1 else -1] = np.nan
            largest = np.fmax(largest, np.sqrt(((beside - grid) ** 2).sum(-1)))
    return largest.ravel()
