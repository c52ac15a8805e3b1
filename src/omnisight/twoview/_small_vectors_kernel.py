"""Compiled operations on vectors of three numbers and on poses [R | t] (3, 4)."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_helper


@njit_helper
def cross(u, v):
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


@njit_helper
def dot(u, v):
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@njit_helper
def times(matrix, v):
    """Return the product of the first three columns of a matrix with a vector."""
    return dot(matrix[0], v), dot(matrix[1], v), dot(matrix[2], v)


@njit_helper
def transposed_times(matrix, v):
    return (
        matrix[0, 0] * v[0] + matrix[1, 0] * v[1] + matrix[2, 0] * v[2],
        matrix[0, 1] * v[0] + matrix[1, 1] * v[1] + matrix[2, 1] * v[2],
        matrix[0, 2] * v[0] + matrix[1, 2] * v[1] + matrix[2, 2] * v[2],
    )


@njit_helper
def quadratic_form(matrix, u, v):
    """Return u^T M v."""
    return dot(u, (dot(matrix[0], v), dot(matrix[1], v), dot(matrix[2], v)))


@njit_helper
def perpendiculars(v):
    """Return two unit vectors perpendicular to a unit vector and to each other.

    T. Duff et al., Building an orthonormal basis, revisited, JCGT 2017.
    """
    x, y, z = v[0], v[1], v[2]
    sign = np.copysign(1.0, z)
    scale = -1.0 / (sign + z)
    product = x * y * scale
    return (1.0 + sign * x * x * scale, sign * product, -sign * x), (product, sign + y * y * scale, -y)


@njit_helper
def whitened(first, second, variance, covariance, second_variance):
    """Return vectors along which a noise has unit variance and no correlation, given perpendicular unit vectors.

    With the variances and the covariance of the noise along both, these are the rows of the inverse Cholesky factor.
    """
    slope = covariance / max(variance, 1e-300)
    one = 1.0 / np.sqrt(max(variance, 1e-300))
    two = 1.0 / np.sqrt(max(second_variance - slope * covariance, 1e-300))
    return (one * first[0], one * first[1], one * first[2]), (
        two * (second[0] - slope * first[0]),
        two * (second[1] - slope * first[1]),
        two * (second[2] - slope * first[2]),
    )


@njit_helper
def rotate_and_translate(pose, step):
    """Move a pose by a step (w, v) (6,), in place: R <- exp(w) R, t <- t + v."""
    rotate(pose, (step[0], step[1], step[2]))
    for i in range(3):
        pose[i, 3] += step[3 + i]


@njit_helper
def rotate(pose, w):
    """Rotate the first three columns of a pose in place, R <- exp(w) R, by the formula of Rodrigues.

    Without products and assignments of arrays, which take numba 6 s to compile.
    """
    angle = np.sqrt(dot(w, w))
    s = np.sin(angle) / angle if angle > 1e-12 else 1.0
    c = (1.0 - np.cos(angle)) / angle**2 if angle > 1e-6 else 0.5
    for j in range(3):
        once = cross(w, (pose[0, j], pose[1, j], pose[2, j]))
        twice = cross(w, once)
        for i in range(3):
            pose[i, j] += s * once[i] + c * twice[i]


@njit_helper
def copy_elements(target, source):
    """Copy the elements of a matrix in loops: an assignment of arrays takes numba seconds to compile."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]
