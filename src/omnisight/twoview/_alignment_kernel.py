"""Compiled alignment of directions and points, and the solver for a rotation from two pairs of bearings."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_helper

# Sine of the angle between two vectors below which they span no plane.
MIN_SINE = 1e-12


@njit_helper
def two_point_rotation(a, b, poses):
    """Compute the rotation that aligns two pairs of bearings best, without translation; return the number of poses.

    The bisectors of both pairs coincide, so the angles between the paired bearings are equal.

    Parameters
    ----------
    a, b
        (2, 3) bearings of both cameras.
    poses
        (1, 3, 4), receives [R | 0] with x_b = R x_a.
    """
    if not rotation_between(a[0] + a[1], a[0] - a[1], b[0] + b[1], b[0] - b[1], poses[0]):
        return 0
    poses[0, :, 3] = 0.0
    return 1


@njit_helper
def rotation_between(u, v, u_rotated, v_rotated, pose):
    """Compute the rotation that turns the direction u and the plane of u and v into those of the rotated vectors.

    Writes the first three columns of the pose (3, 4). Returns False if two vectors are parallel.
    """
    source, target = np.empty((3, 3)), np.empty((3, 3))
    if not (_axes(u, v, source) and _axes(u_rotated, v_rotated, target)):
        return False
    for i in range(3):
        for j in range(3):
            pose[i, j] = target[0, i] * source[0, j] + target[1, i] * source[1, j] + target[2, i] * source[2, j]
    return True


@njit_helper
def fill_translation(points, posed, pose):
    """Compute the last column of a pose (3, 4): the mean difference of the posed points from the rotated points."""
    for i in range(3):
        pose[i, 3] = 0.0
        for n in range(len(points)):
            rotated = pose[i, 0] * points[n, 0] + pose[i, 1] * points[n, 1] + pose[i, 2] * points[n, 2]
            pose[i, 3] += (posed[n, i] - rotated) / len(points)


@njit_helper
def _axes(u, v, axes):
    """Compute orthonormal axes, the rows of (3, 3): along u, along u x v, and normal to both."""
    length = np.sqrt(u[0] ** 2 + u[1] ** 2 + u[2] ** 2)
    nx, ny, nz = u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]
    normal = np.sqrt(nx * nx + ny * ny + nz * nz)
    if not normal > MIN_SINE * length * np.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2):
        return False
    axes[1, 0], axes[1, 1], axes[1, 2] = nx / normal, ny / normal, nz / normal
    for i in range(3):
        axes[0, i] = u[i] / length
    for i in range(3):
        after, last = (i + 1) % 3, (i + 2) % 3
        axes[2, i] = axes[0, after] * axes[1, last] - axes[0, last] * axes[1, after]
    return True


@njit_helper
def orthonormalize(rotation):
    """Move three columns that are nearly a rotation towards the nearest rotation, by a step R (3 I - R^T R)/2."""
    gram = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            dot = rotation[0, i] * rotation[0, j] + rotation[1, i] * rotation[1, j] + rotation[2, i] * rotation[2, j]
            gram[i, j] = (1.5 if i == j else 0.0) - 0.5 * dot
    for i in range(3):
        x, y, z = rotation[i, 0], rotation[i, 1], rotation[i, 2]
        for j in range(3):
            rotation[i, j] = x * gram[0, j] + y * gram[1, j] + z * gram[2, j]


@njit_helper
def multiply(left, right):
    """Return the product of two small matrices, for which a call of BLAS takes longer than the loop."""
    product = np.zeros((len(left), right.shape[1]))
    for i in range(len(left)):
        for k in range(len(right)):
            for j in range(right.shape[1]):
                product[i, j] += left[i, k] * right[k, j]
    return product
