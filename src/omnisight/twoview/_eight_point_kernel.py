"""Compiled eight-point solver: the relative pose of eight or more pairs of bearings by linear least squares.

R. I. Hartley, In defense of the eight-point algorithm, PAMI 19, 1997. Bearings all around a camera have no image plane,
so they are normalized by a linear map: the square root of the inverse of their second moments. It is nearly a multiple
of the identity for the whole sphere, and stretches a narrow field of view.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_helper
from omnisight.optim._eigen_kernel import symmetric_eigen
from omnisight.twoview._alignment_kernel import multiply, orthonormalize
from omnisight.twoview._essential_kernel import decompose_essential

# Least second moment relative to the largest: bearings on a great circle have zero.
MIN_MOMENT = 1e-12


@njit_helper
def eight_point(a, b, weights, poses):
    """Compute the pose of N >= 8 pairs of bearings with the most positive distances; return the number, 0 or 1.

    Parameters
    ----------
    a, b
        (N, 3) bearings of both cameras.
    weights
        (N,) weights of the squared residuals.
    poses
        (1, 3, 4), receives [R | t] with x_b = R x_a + t and t of unit length.
    """
    scale_a, scale_b = np.empty((3, 3)), np.empty((3, 3))
    if not (_normalization(a, weights, scale_a) and _normalization(b, weights, scale_b)):
        return 0
    scaled = _least_squares(multiply(a, scale_a), multiply(b, scale_b), weights)
    e = multiply(scale_b, multiply(scaled, scale_a))  # both scales are symmetric
    if decompose_essential(_nearest_essential(e), a, b, poses[0]) == 0:
        return 0
    orthonormalize(poses[0])
    return 1


@njit_helper
def _normalization(bearings, weights, scale):
    """Compute the inverse square root (3, 3) of the second moments of bearings; return False if it does not exist."""
    moments, values, axes = np.zeros((3, 3)), np.empty(3), np.empty((3, 3))
    for n in range(len(bearings)):
        for i in range(3):
            for j in range(3):
                moments[i, j] += weights[n] * bearings[n, i] * bearings[n, j]
    symmetric_eigen(moments, values, axes)
    if not values[2] > 0.0:
        return False
    scale[:] = 0.0
    for k in range(3):
        factor = np.sqrt(values[2] / max(values[k], MIN_MOMENT * values[2]))
        for i in range(3):
            for j in range(3):
                scale[i, j] += factor * axes[k, i] * axes[k, j]
    return True


@njit_helper
def _least_squares(a, b, weights):
    """Return the matrix of unit norm with the least sum of squares of b^T E a."""
    normal, values, vectors = np.zeros((9, 9)), np.empty(9), np.empty((9, 9))
    row = np.empty(9)
    for n in range(len(a)):
        for i in range(9):
            row[i] = b[n, i // 3] * a[n, i % 3]
        for i in range(9):
            for j in range(i + 1):
                normal[i, j] += weights[n] * row[i] * row[j]
    for i in range(9):
        for j in range(i):
            normal[j, i] = normal[i, j]
    symmetric_eigen(normal, values, vectors)
    return vectors[0].copy().reshape(3, 3)


@njit_helper
def _nearest_essential(e):
    """Return the matrix with the singular vectors of a matrix (3, 3) and the singular values 1, 1, 0."""
    values, right = np.empty(3), np.empty((3, 3))
    symmetric_eigen(multiply(e.T, e), values, right)
    left = multiply(right, e.T)  # row k is E v_k
    nearest = np.zeros((3, 3))
    for k in range(1, 3):
        length = np.sqrt(left[k, 0] ** 2 + left[k, 1] ** 2 + left[k, 2] ** 2)
        for i in range(3):
            for j in range(3):
                nearest[i, j] += left[k, i] / length * right[k, j]
    return nearest
