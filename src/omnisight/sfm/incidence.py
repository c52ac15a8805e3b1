"""Differences of unknowns along the edges of a graph."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array

Indices = NDArray[np.intp]


def incidence_matrix(count: int, a: Indices, b: Indices) -> Any:
    """Return the sparse matrix (E, N - 1) of x_b - x_a along edges a, b (E,) of N unknowns with x_0 = 0."""
    rows, ones = np.arange(len(a)), np.ones(len(a))
    ends = np.tile(rows, 2), np.concatenate([a, b])
    return coo_array((np.concatenate([-ones, ones]), ends), shape=(len(a), count)).tocsr()[:, 1:]
