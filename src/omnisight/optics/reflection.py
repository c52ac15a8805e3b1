"""The law of reflection."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def reflect(bearings: ArrayLike, normals: ArrayLike) -> Array:
    """Give the bearings that light, or sight, leaves a mirror with: r = d - 2 (d . n) n.

    Parameters
    ----------
    bearings
        (..., 3) as they come in.
    normals
        (..., 3) unit normals of the surface, to either side.

    Returns
    -------
    (..., 3), as long as what came in.
    """
    d, n = np.asarray(bearings, float), np.asarray(normals, float)
    return d - 2 * (d * n).sum(-1, keepdims=True) * n
