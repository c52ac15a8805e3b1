"""Rays over mirrors."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.rays import Rays
from omnisight.optics.placed import Placed
from omnisight.optics.reflection import reflect

Array = NDArray[np.float64]


def trace(placed: Sequence[Placed], rays: Rays) -> Rays:
    """Follow rays (N, 3) of a lens over its mirrors, to where and how they leave the last one."""
    origins, bearings, valid = rays
    before = None
    with np.errstate(all="ignore"):
        for p in placed:
            pose = p.lens_from_mirror
            o, d = (origins - pose.translation) @ pose.rotation, bearings @ pose.rotation
            distance, hit = p.mirror.intersect(o, d)
            valid = valid & hit & free(placed, origins, bearings, distance, before, p)
            at = o + distance[:, None] * d
            origins = pose @ at
            bearings = reflect(d, p.mirror.normal(at)) @ pose.rotation.T
            before = p
        valid = valid & free(placed, origins, bearings, np.full(len(valid), np.inf), before)
    lost = ~valid
    origins[lost] = bearings[lost] = np.nan
    return Rays(origins, bearings, valid)


def free(
    placed: Sequence[Placed],
    origins: Array,
    bearings: Array,
    lengths: Array,
    leaving: Placed | None,
    reaching: Placed | None = None,
) -> NDArray[np.bool_]:
    """Say along which rays (N, 3) no mirror stands before that length (N,).

    They leave one mirror and reach another, both on the sides that reflect: convex ones cannot be met between.
    """
    clear = np.ones(len(lengths), np.bool_)
    for p in placed:
        if p.mirror.convex and (p is leaving or p is reaching):
            continue
        pose = p.lens_from_mirror
        clear &= p.mirror.clear((origins - pose.translation) @ pose.rotation, bearings @ pose.rotation, lengths)
    return clear
