"""Join saddle points into lattices.

After A. Geiger, F. Moosmann, O. Car, B. Schuster: Automatic camera and range sensor calibration using a single shot
(ICRA 2012): a board is grown from a seed by local prediction, which any smooth distortion permits. Here neighbours must
also be negatives of each other, as two corners on one edge of a checkerboard are.
"""

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.detectors.checkerboard.lattice import Lattice
from omnisight.targets.detectors.checkerboard.saddles import Saddles

# Side, px, of the buckets that saddle points are sorted into for range queries: speed only.
BUCKET_PX = 32.0


def grow_lattices(saddles: Saddles, min_corners: int) -> list[Lattice]:
    """Join saddle points into lattices of at least `min_corners`, the largest first; NaN where a corner is missing."""
    from omnisight.targets.detectors.checkerboard import _growth_kernel

    pixels = saddles.pixels
    if len(pixels) < min_corners:
        return []
    place = (pixels // BUCKET_PX).astype(np.int64)
    columns, rows = place.max(axis=0) + 1
    bucket = place[:, 1] * columns + place[:, 0]
    items = np.argsort(bucket, kind="stable")
    starts = np.searchsorted(bucket[items], np.arange(columns * rows + 1))
    buckets = _growth_kernel.Buckets(items, starts, columns, rows, BUCKET_PX)
    count, cells = _growth_kernel.grow(saddles, buckets, min_corners)
    members = [np.flatnonzero(cells[:, 0] == lattice) for lattice in range(count)]
    return [_as_lattice(pixels[m], cells[m, 1:]) for m in sorted(members, key=len, reverse=True)]


def _as_lattice(pixels: Lattice, cells: NDArray[np.int64]) -> Lattice:
    cells = cells - cells.min(axis=0)
    lattice = np.full((*(cells.max(axis=0) + 1), 2), np.nan)
    lattice[cells[:, 0], cells[:, 1]] = pixels
    return lattice
