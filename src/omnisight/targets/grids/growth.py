"""Joins saddle points into grids.

After A. Geiger, F. Moosmann, O. Car, B. Schuster: Automatic camera and range sensor calibration using a single shot
(ICRA 2012): a board is grown from a seed by local prediction, so a lens may bend it as it likes. Here neighbours must
also be negatives of each other, as two corners on one edge of a checkerboard are.
"""

from __future__ import annotations

import numpy as np

from .lattice import Lattice
from .saddles import Saddles

_BUCKET = 32.0
"""Side in px of the squares that saddle points are sorted into, to be found again by place."""


def grow_lattices(saddles: Saddles, smallest: int = 9) -> list[Lattice]:
    """Join saddle points into grids of at least `smallest` corners, the largest first; NaN where one is missing."""
    from ._growth_kernel import grow

    pixels = saddles.pixels
    if len(pixels) < smallest:
        return []
    place = (pixels // _BUCKET).astype(np.int64)
    wide, high = place.max(axis=0) + 1
    bucket = place[:, 1] * wide + place[:, 0]
    items = np.argsort(bucket, kind="stable")
    starts = np.searchsorted(bucket[items], np.arange(wide * high + 1))
    space = (items, starts, wide, high, _BUCKET)
    count, cells = grow(saddles.smooth, pixels, saddles.rings, saddles.edges, saddles.amplitude, space, smallest)
    grids = [np.flatnonzero(cells[:, 0] == grid) for grid in range(count)]
    return [_as_lattice(pixels[members], cells[members, 1:]) for members in sorted(grids, key=len, reverse=True)]


def _as_lattice(pixels: Lattice, where: np.ndarray) -> Lattice:
    where = where - where.min(axis=0)
    lattice = np.full((*(where.max(axis=0) + 1), 2), np.nan)
    lattice[where[:, 0], where[:, 1]] = pixels
    return lattice
