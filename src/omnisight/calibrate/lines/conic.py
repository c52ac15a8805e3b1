"""The conic that a line makes in a central catadioptric picture."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.models.unified import Unified

Array = NDArray[np.float64]


def line_conic(model: Unified, normal: ArrayLike) -> Array:
    """Give the conic Omega (3, 3), p^T Omega p = 0 for pixels p = (u, v, 1), that holds the image of a line.

    Parameters
    ----------
    model
        A camera of the unified model.
    normal
        (3,) normal of the plane through the viewpoint and the line, of any length.

    Notes
    -----
    A point m = (x, y, 1) of the normalised plane is the point P = lambda m - xi e_z of the sphere. From n . P = 0 and
    |P| = 1, without lambda:

    xi^2 n_z^2 m.m - 2 xi^2 n_z (n.m) + (xi^2 - 1) (n.m)^2 = 0,

    then m = K^-1 p (Barreto and Araujo, Geometric properties of central catadioptric line images and their application
    in calibration, PAMI 2005, eq. 6, with the opposite sign). A circle for xi = 1, a double line for xi = 0. It is the
    image of the whole great circle and of its mirror image through the second viewpoint: half of it may be no picture
    of anything.
    """
    n = np.asarray(normal, float)
    n = n / np.linalg.norm(n)
    xi2, nz = model.xi**2, n[2]
    towards = np.outer(n, (0.0, 0.0, 1.0))
    omega = xi2 * nz**2 * np.eye(3) - xi2 * nz * (towards + towards.T) + (xi2 - 1) * np.outer(n, n)
    k = np.array([[model.fx, model.skew, model.cx], [0.0, model.fy, model.cy], [0.0, 0.0, 1.0]])
    inverse = np.linalg.inv(k)
    return inverse.T @ omega @ inverse
