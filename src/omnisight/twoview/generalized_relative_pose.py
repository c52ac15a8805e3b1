"""Relative pose of a rig or of a non-central camera from pairs of rays, with metric scale."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# Each pair is one equation of the 18 elements of E and R, up to their scale.
MIN_PAIRS = 17
# Singular value relative to the largest below which a constraint on the rotation is rounding.
ROUNDING = 1e-9


def seventeen_point(origins_a: ArrayLike, bearings_a: ArrayLike, origins_b: ArrayLike, bearings_b: ArrayLike) -> Array:
    """Compute the relative pose of a rig from seventeen or more pairs of rays by linear least squares.

    The lines (f, m) with direction f and moment m = o x f fulfil f_b.E f_a + f_b.R m_a + m_b.R f_a = 0. The essential
    matrix E = [t]x R is estimated first, for any R, so a rig whose cameras see no points of each other is not
    degenerate. With its rotation, the constraints are linear in t. Degenerate if all rays of the rig have a common
    origin, and if a rig of such cameras does not rotate: the scale is unknown.

    H. Li, R. Hartley and J.-H. Kim, A linear approach to motion estimation using generalized camera models, CVPR 2008.

    Parameters
    ----------
    origins_a, bearings_a, origins_b, bearings_b
        (N, 3) origins and directions of the rays in the frame of the rig at both times, N >= 17.

    Returns
    -------
    poses
        (S, 3, 4) `b_from_a` with S <= 1, in the unit of the origins: the pose with the most pairs at positive
        distances. It may not be all of them.

    Raises
    ------
    ValueError
        If an array has another shape.
    """
    rays = [np.asarray(array, float) for array in (origins_a, bearings_a, origins_b, bearings_b)]
    count = max(len(rays[0]), MIN_PAIRS)
    for array in rays:
        if array.shape != (count, 3):
            raise ValueError(f"expected an array of shape ({count}, 3), got {array.shape}")
    if not all(np.isfinite(array).all() for array in rays):
        return np.empty((0, 3, 4))
    poses = [_with_translation(rotation, *rays) for rotation in _rotations(_essential_matrix(*rays))]
    positive = [_positive_distances(pose, *rays) for pose in poses]
    best = int(np.argmax(positive))
    return poses[best][None] if positive[best] > 0 else np.empty((0, 3, 4))


def _essential_matrix(origins_a: Array, a: Array, origins_b: Array, b: Array) -> Array:
    """Return the matrix E of unit norm that fulfils the constraints best with any matrix R."""
    of_e = _products(b, a)
    of_r = _products(b, np.cross(origins_a, a)) + _products(np.cross(origins_b, b), a)
    left, values, _ = np.linalg.svd(of_r, full_matrices=False)
    range_of_r = left[:, values > ROUNDING * values[0]]
    without_r = of_e - range_of_r @ (range_of_r.T @ of_e)
    return np.linalg.svd(without_r, full_matrices=False)[2][-1].reshape(3, 3)


def _products(b: Array, a: Array) -> Array:
    """Return the coefficients (N, 9) of the entries of M in b^T M a."""
    return np.einsum("ni,nj->nij", b, a).reshape(-1, 9)


def _rotations(e: Array) -> list[Array]:
    """Return the two rotations of an essential matrix."""
    u, _, vt = np.linalg.svd(e)
    u, vt = u * np.linalg.det(u), vt * np.linalg.det(vt)
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return [u @ quarter @ vt, u @ quarter.T @ vt]


def _with_translation(rotation: Array, origins_a: Array, a: Array, origins_b: Array, b: Array) -> Array:
    """Return the pose with the least-squares translation: t.(p x q) = (o_b - R o_a).(p x q) with p = R a, q = b."""
    normals = np.cross(a @ rotation.T, b)
    offsets = origins_b - origins_a @ rotation.T
    translation = np.linalg.lstsq(normals, (normals * offsets).sum(1), rcond=None)[0]
    return np.column_stack([rotation, translation])


def _positive_distances(pose: Array, origins_a: Array, a: Array, origins_b: Array, b: Array) -> int:
    """Return the number of pairs with positive distances along both rays."""
    p = a @ pose[:, :3].T
    between = origins_a @ pose[:, :3].T + pose[:, 3] - origins_b
    normals = np.cross(p, b)
    along_a, along_b = (-(np.cross(between, x) * normals).sum(1) for x in (b, p))
    return int(((along_a > 0) & (along_b > 0)).sum())
