"""Tracing of rays from a lens over its mirrors."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.rays import Rays
from omnisight.optics.placed_mirror import PlacedMirror
from omnisight.optics.reflection import reflect

Array = NDArray[np.float64]


def trace(placed: Sequence[PlacedMirror], rays: Rays) -> Rays:
    """Trace rays (N, 3) of a lens; return them as they leave the last mirror."""
    origins, bearings, valid = rays
    previous = None
    with np.errstate(all="ignore"):
        for p in placed:
            pose = p.lens_from_mirror
            o, d = (origins - pose.translation) @ pose.rotation, bearings @ pose.rotation
            distance, hit = p.mirror.intersect(o, d)
            valid = valid & hit & is_unobstructed(placed, origins, bearings, distance, previous, p)
            at = o + distance[:, None] * d
            origins = pose @ at
            bearings = reflect(d, p.mirror.normal(at)) @ pose.rotation.T
            previous = p
        valid = valid & is_unobstructed(placed, origins, bearings, np.full(len(valid), np.inf), previous)
    origins[~valid] = bearings[~valid] = np.nan
    return Rays(origins, bearings, valid)


def is_unobstructed(
    placed: Sequence[PlacedMirror],
    origins: Array,
    bearings: Array,
    lengths: Array,
    leaving: PlacedMirror | None,
    reaching: PlacedMirror | None = None,
) -> NDArray[np.bool_]:
    """Return which rays (N, 3) meet no mirror within a length (N,).

    The rays start on the reflecting side of `leaving` and end on that of `reaching`. If these mirrors are convex they
    cannot obstruct the ray and are skipped.
    """
    unobstructed = np.ones(len(lengths), np.bool_)
    for p in placed:
        if p.mirror.convex and (p is leaving or p is reaching):
            continue
        pose = p.lens_from_mirror
        o, d = (origins - pose.translation) @ pose.rotation, bearings @ pose.rotation
        unobstructed &= p.mirror.is_unobstructed(o, d, lengths)
    return unobstructed
