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
def rotate_and_translate(pose, step):
    """Move a pose by a step (w, v) (6,), in place: R <- exp(w) R, t <- t + v."""
    x, y, z = step[0], step[1], step[2]
    angle = np.sqrt(x * x + y * y + z * z)
    s = np.sin(angle) / angle if angle > 1e-12 else 1.0
    c = (1.0 - np.cos(angle)) / angle**2 if angle > 1e-6 else 0.5
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation = np.eye(3) + s * skew + c * (skew @ skew)
    pose[:, :3] = rotation @ pose[:, :3].copy()
    pose[:, 3] += step[3:]
