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
def pseudo_inverse(matrix):
    """Return the pseudo-inverse of a positive semidefinite matrix.

    It equals that of `np.linalg.pinv`, which takes numba 3 s to compile.
    """
    size = len(matrix)
    values, vectors = np.empty(size), np.empty((size, size))
    symmetric_eigen(matrix.copy(), values, vectors)
    least = size * ROUNDING * values[size - 1]
    for k in range(size):
        values[k] = 1.0 / values[k] if values[k] > least else 0.0
    return matrix_of(values, vectors)


@njit_helper
def matrix_of(values, vectors):
    """Return the symmetric matrix (N, N) of eigenvalues and eigenvectors."""
    size = len(values)
    matrix = np.zeros((size, size))
    for k in range(size):
        for i in range(size):
            for j in range(size):
                matrix[i, j] += values[k] * vectors[k, i] * vectors[k, j]
    return matrix


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
