"""The pose of a plane from bearings: nothing here knows a picture."""

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.views import BoardViews
from omnisight.geometry import rotation as so3

Array = NDArray[np.float64]


def plane_poses(views: BoardViews, bearings: Array) -> tuple[Array, Array]:
    """Give cam_from_board of every picture from the bearings of its corners, linearly.

    A corner (X, Y, 0) is seen along H (X, Y, 1) with H = [r1 r2 t], so that b x H (X, Y, 1) = 0: nine unknowns up to
    scale, whatever the angle from the axis (Hartley and Zisserman, Multiple view geometry, ch. 8, on the sphere). The
    sign is the one that puts the corners at positive distance along their bearings.

    Parameters
    ----------
    views
        The corners; their boards lie in z = 0.
    bearings
        (N, 3) unit; rows of NaN are left out.

    Returns
    -------
    rotations, translations
        (V, 3, 3) and (V, 3), NaN for a picture with too few corners.
    """
    rotations, translations = np.full((len(views), 3, 3), np.nan), np.full((len(views), 3), np.nan)
    for i, rows in enumerate(views.groups):
        b = bearings[rows]
        use = np.isfinite(b).all(-1)
        if use.sum() < 6:
            continue
        rotations[i], translations[i] = _plane_pose(views.points[rows][use, :2], b[use])
    return rotations, translations


def _plane_pose(plane: Array, bearings: Array) -> tuple[Array, Array]:
    centre = plane.mean(0)
    size = np.abs(plane - centre).max() or 1.0
    x = np.concatenate([(plane - centre) / size, np.ones((len(plane), 1))], -1)
    design = np.einsum("nij,nk->nijk", so3.hat(bearings), x).reshape(-1, 9)
    _, vectors = np.linalg.eigh(design.T @ design)
    h = vectors[:, 0].reshape(3, 3)
    if np.einsum("ni,ij,nj->n", bearings, h, x).sum() < 0:
        h = -h
    scale = np.sqrt(np.linalg.norm(h[:, 0]) * np.linalg.norm(h[:, 1])) or 1.0
    r1, r2, t = (h / scale).T
    rotation = so3.nearest(np.stack([r1, r2, np.cross(r1, r2)], -1))
    # Undo the shift and scale of the board's coordinates.
    return rotation, t * size - rotation[:, :2] @ centre
