"""Lattices of corners in the image: local steps, curvature, and predictions from neighbours.

A lattice is an array (rows, columns, 2) of pixels, NaN where a corner is missing. Distortion must be smooth; straight
lines need not stay straight.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Lattice = NDArray[np.float64]


def steps(lattice: Lattice) -> tuple[Lattice, Lattice]:
    """Return the local steps (rows, columns, 2), px, to the next column and to the next row; NaN where unknown."""
    along: list[Lattice] = []
    for i, j in ((0, 1), (1, 0)):
        ahead = shifted(lattice, i, j) - lattice
        behind = lattice - shifted(lattice, -i, -j)
        along.append(_reduced(np.nanmean, np.stack([ahead, behind])))
    return along[0], along[1]


def bends(lattice: Lattice) -> tuple[Lattice, Lattice]:
    """Return the second-order terms (rows, columns, 2), px, of the curves through rows and columns; NaN where unknown.

    With c the corner, s a number of squares and the local step, a row runs through c + s step + s^2 bend. At the end
    of a row, the neighbour's bend is used.
    """
    bent: list[Lattice] = []
    for i, j in ((0, 1), (1, 0)):
        own = (shifted(lattice, i, j) + shifted(lattice, -i, -j)) / 2 - lattice
        for k in (-1, 1):
            beside = shifted(own, k * i, k * j)
            own = np.where(np.isfinite(own), own, beside)
        bent.append(own)
    return bent[0], bent[1]


def spacing(lattice: Lattice) -> NDArray[np.float64]:
    """Return the distance (rows, columns), px, to the nearest neighbour along the row or the column."""
    others = [shifted(lattice, i, j) for i, j in ((0, 1), (0, -1), (1, 0), (-1, 0))]
    return _reduced(np.nanmin, np.stack([np.linalg.norm(other - lattice, axis=-1) for other in others]))


def orientation(lattice: Lattice) -> NDArray[np.float64]:
    """Return the signed area (rows, columns), px^2, of the local step parallelogram; clockwise is positive."""
    column, row = steps(lattice)
    return column[..., 0] * row[..., 1] - column[..., 1] * row[..., 0]


def predictions(lattice: Lattice) -> Lattice:
    """Predict each corner (rows, columns, 2) from its neighbours alone.

    The result is the median of several predictors, each a smooth curve through other corners of the row or the column,
    or a parallelogram: it is robust to a wrong neighbour.
    """
    predictors: list[Lattice] = []
    for i, j in ((0, 1), (1, 0)):
        p = {k: shifted(lattice, k * i, k * j) for k in range(-3, 4)}
        line = (p[-1] + p[1]) / 2
        cubic = (4 * (p[-1] + p[1]) - p[-2] - p[2]) / 6
        predictors.append(np.where(np.isfinite(cubic), cubic, line))
        predictors += [3 * p[k] - 3 * p[2 * k] + p[3 * k] for k in (-1, 1)]
    for i in (-1, 1):
        for j in (-1, 1):
            predictors.append(shifted(lattice, i, 0) + shifted(lattice, 0, j) - shifted(lattice, i, j))
    return _median(np.stack(predictors))


def shifted(lattice: NDArray[np.float64], i: int, j: int) -> NDArray[np.float64]:
    """Return the lattice whose [r, c] is the given one's [r + i, c + j]; NaN past its ends."""
    rows, columns = lattice.shape[:2]
    out = np.full_like(lattice, np.nan)
    if abs(i) < rows and abs(j) < columns:
        out[max(-i, 0) : rows - max(i, 0), max(-j, 0) : columns - max(j, 0)] = lattice[
            max(i, 0) : rows - max(-i, 0), max(j, 0) : columns - max(-j, 0)
        ]
    return out


def _reduced(reduce: Callable[..., Any], stack: NDArray[np.float64]) -> NDArray[np.float64]:
    """Apply a NaN-skipping reduction along axis 0; NaN, without NumPy's warning, where there is only NaN."""
    # warnings.catch_warnings would change the whole process, and images are searched in threads.
    empty = ~np.isfinite(stack).any(axis=0)
    return np.where(empty, np.nan, reduce(np.where(empty, 0.0, stack), axis=0))


def _median(stack: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the median of the finite values along axis 0, several times faster than `np.nanmedian`."""
    ordered = np.sort(stack, axis=0)  # NaN last
    count = np.isfinite(stack).sum(axis=0, keepdims=True)
    middle = [np.take_along_axis(ordered, np.maximum(k, 0), axis=0)[0] for k in ((count - 1) // 2, count // 2)]
    return np.where(count[0] > 0, (middle[0] + middle[1]) / 2, np.nan)


def corner_count(lattice: Lattice) -> int:
    """Return the number of corners that are not missing."""
    return int(np.isfinite(lattice[..., 0]).sum())


def parity(shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return alternating signs (rows, columns), 1 at [0, 0]."""
    i, j = np.indices(shape[:2])
    return 1.0 - 2.0 * ((i + j) % 2)
