"""Compiled eigenvalues of small symmetric matrices."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_helper

MAX_SWEEPS = 30
# Relative rounding error of a number.
ROUNDING = 2.0**-52


@njit_helper
def symmetric_eigen(matrix, values, vectors):
    """Compute the eigenvalues (N,), ascending, and eigenvectors, the rows of (N, N), by Jacobi rotations.

    The matrix is overwritten.
    """
    size = len(matrix)
    vectors[:] = 0.0
    for i in range(size):
        vectors[i, i] = 1.0
    for _ in range(MAX_SWEEPS):
        if not _sweep(matrix, vectors):
            break
    for i in range(size):
        values[i] = matrix[i, i]
    for i in range(size):
        least = i
        for k in range(i + 1, size):
            if values[k] < values[least]:
                least = k
        values[i], values[least] = values[least], values[i]
        for k in range(size):
            vectors[i, k], vectors[least, k] = vectors[least, k], vectors[i, k]


@njit_helper
def solve_least_norm(matrix, right):
    """Return the solution of least norm of a positive semidefinite system.

    It equals that of `np.linalg.lstsq`, which takes numba 3 s to compile.
    """
    root = np.empty(matrix.shape)
    inverse_root(matrix, root)
    return times_gram(root, right)


@njit_helper
def inverse_root(matrix, root):
    """Compute B (N, N) whose B^T B is the pseudo-inverse of a positive semidefinite matrix."""
    size = len(matrix)
    values = np.empty(size)
    symmetric_eigen(matrix.copy(), values, root)
    for k in range(size):
        factor = 1.0 / np.sqrt(values[k]) if values[k] > size * ROUNDING * values[size - 1] else 0.0
        for i in range(size):
            root[k, i] *= factor


@njit_helper
def times_gram(root, vector):
    """Return B^T B v."""
    product = np.zeros(len(vector))
    for k in range(len(root)):
        along = 0.0
        for i in range(len(vector)):
            along += root[k, i] * vector[i]
        for i in range(len(vector)):
            product[i] += along * root[k, i]
    return product


@njit_helper
def _sweep(matrix, vectors):
    """Rotate each off-diagonal entry to zero; return whether any was larger than rounding."""
    size = len(matrix)
    has_rotated = False
    for p in range(size):
        for q in range(p + 1, size):
            entry = matrix[p, q]
            if not abs(entry) > 1e-16 * np.sqrt(abs(matrix[p, p] * matrix[q, q])):
                continue
            has_rotated = True
            ratio = (matrix[q, q] - matrix[p, p]) / (2.0 * entry)
            tangent = 1.0 / (abs(ratio) + np.sqrt(1.0 + ratio * ratio))
            if ratio < 0.0:
                tangent = -tangent
            cosine = 1.0 / np.sqrt(1.0 + tangent * tangent)
            sine = tangent * cosine
            for k in range(size):
                matrix[k, p], matrix[k, q] = _rotated(matrix[k, p], matrix[k, q], cosine, sine)
            for k in range(size):
                matrix[p, k], matrix[q, k] = _rotated(matrix[p, k], matrix[q, k], cosine, sine)
                vectors[p, k], vectors[q, k] = _rotated(vectors[p, k], vectors[q, k], cosine, sine)
            matrix[p, q] = matrix[q, p] = 0.0
    return has_rotated


@njit_helper
def _rotated(x, y, cosine, sine):
    return cosine * x - sine * y, sine * x + cosine * y
