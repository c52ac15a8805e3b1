"""The law of reflection."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def reflect(bearings: ArrayLike, normals: ArrayLike) -> Array:
    """Reflect bearings at a surface: r = d - 2 (d . n) n.

    Parameters
    ----------
    bearings
        (..., 3) incoming.
    normals
        (..., 3) unit normals of the surface; the sign does not matter.

    Returns
    -------
    (..., 3) reflected, of the same length as `bearings`.
    """
    d, n = np.asarray(bearings, float), np.asarray(normals, float)
    return d - 2 * (d * n).sum(-1, keepdims=True) * n
