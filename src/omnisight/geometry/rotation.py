"""Rotations of 3-space as matrices and rotation vectors."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def hat(vectors: ArrayLike) -> Array:
    """Return the cross-product matrices (..., 3, 3) of vectors (..., 3): hat(v) w = v x w."""
    v = np.asarray(vectors, float)
    matrices = np.zeros((*v.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        matrices[..., k, j] = v[..., i]
        matrices[..., j, k] = -v[..., i]
    return matrices


def exp(vectors: ArrayLike) -> Array:
    """Return the rotations (..., 3, 3) of rotation vectors (..., 3), radians (Rodrigues' formula)."""
    v = np.asarray(vectors, float)
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    angle = np.sqrt(x * x + y * y + z * z)
    safe = np.where(angle > 0, angle, 1.0)
    s = np.where(angle > 0, np.sin(angle) / safe, 1.0)
    half = np.where(angle > 0, np.sin(0.5 * angle) / safe, 0.5)
    c = 2 * half * half  # (1 - cos(angle))/angle^2 without cancellation
    xy, xz, yz, cx, cy, cz = c * x * y, c * x * z, c * y * z, c * x * x, c * y * y, c * z * z
    sx, sy, sz = s * x, s * y, s * z
    rotations = np.empty((*v.shape, 3))
    rotations[..., 0, 0], rotations[..., 0, 1], rotations[..., 0, 2] = 1 - cy - cz, xy - sz, xz + sy
    rotations[..., 1, 0], rotations[..., 1, 1], rotations[..., 1, 2] = xy + sz, 1 - cx - cz, yz - sx
    rotations[..., 2, 0], rotations[..., 2, 1], rotations[..., 2, 2] = xz - sy, yz + sx, 1 - cx - cy
    return rotations


def log(rotations: ArrayLike) -> Array:
    """Return the rotation vectors (..., 3), of length at most pi, of rotations (..., 3, 3)."""
    r = np.asarray(rotations, float)
    axis = np.empty(r.shape[:-1])
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        axis[..., i] = (r[..., k, j] - r[..., j, k]) / 2
    sine = np.sqrt((axis * axis).sum(-1))
    angle = np.arctan2(sine, (r[..., 0, 0] + r[..., 1, 1] + r[..., 2, 2] - 1) / 2)
    vector = axis * (angle / np.where(sine > 0, sine, 1.0))[..., None]
    is_small_sine = sine <= 1e-7
    if not is_small_sine.any():
        return vector
    # Near pi the antisymmetric part vanishes: the axis is then the largest column of (R + R^T)/2 + I.
    symmetric = (r + np.swapaxes(r, -1, -2)) / 2 + np.eye(3)
    largest = np.argmax(np.diagonal(symmetric, axis1=-2, axis2=-1), -1)
    column = np.take_along_axis(symmetric, largest[..., None, None], -1)[..., 0]
    column = column / np.linalg.norm(column, axis=-1, keepdims=True)
    column *= np.where((column * axis).sum(-1, keepdims=True) < 0, -1.0, 1.0)
    near = np.where((angle > 1)[..., None], column * angle[..., None], axis)
    return np.where(is_small_sine[..., None], near, vector)


def quaternions(rotations: ArrayLike) -> Array:
    """Return the unit quaternions (..., 4), x y z w with w >= 0, of rotations (..., 3, 3)."""
    from scipy.spatial.transform import Rotation  # scipy is slow to import

    matrices = np.asarray(rotations, float)
    xyzw = Rotation.from_matrix(matrices.reshape(-1, 3, 3)).as_quat(canonical=True)
    return np.asarray(xyzw, float).reshape(*matrices.shape[:-2], 4)


def nearest(matrices: ArrayLike) -> Array:
    """Return the rotations nearest to matrices (..., 3, 3), by the singular value decomposition."""
    u, _, vt = np.linalg.svd(np.asarray(matrices, float))
    u[..., :, 2] *= np.linalg.det(u @ vt)[..., None]
    return u @ vt


# camera_from_level: a level frame (x right, y down, z forward) in the camera frame, by the side the world's up is on.
_CAMERA_FROM_LEVEL = {
    "top": np.eye(3),
    "back": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "front": np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, -1.0, 0.0]]),
}


def look(yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0, *, up: str = "top", flip: bool = False) -> Array:
    """Return the rotation target_from_source (3, 3) of a view with another direction than the camera.

    Parameters
    ----------
    yaw, pitch, roll
        Degrees. Positive yaw turns the view right, pitch up, roll clockwise as seen from behind.
    up
        Direction of the world's up: "top" for a level camera (up is the top of the image), "back" for a camera that
        looks down or into a mirror above it (the image centre is the nadir), "front" for a camera that looks up.
    flip
        Exchange left and right, as in the image of a camera that looks into a mirror.

    Raises
    ------
    ValueError
        If `up` is none of the three.
    """
    if up not in _CAMERA_FROM_LEVEL:
        raise ValueError(f"up must be one of {', '.join(_CAMERA_FROM_LEVEL)}, got {up!r}")
    y, p, r = np.radians([yaw, pitch, roll])
    turn = (
        np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
        @ np.array([[1, 0, 0], [0, np.cos(p), -np.sin(p)], [0, np.sin(p), np.cos(p)]])
        @ np.array([[np.cos(r), -np.sin(r), 0], [np.sin(r), np.cos(r), 0], [0, 0, 1]])
    )
    camera_from_level = _CAMERA_FROM_LEVEL[up] @ np.diag([-1.0 if flip else 1.0, 1.0, 1.0])
    return (camera_from_level @ turn).T
