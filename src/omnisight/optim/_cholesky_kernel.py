"""Compiled solution of small symmetric systems."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_helper


@njit_helper
def solve_symmetric(matrix, right):
    """Return the solution of a positive definite system, given its lower triangle, which is overwritten.

    The solution is zero if the matrix is not positive definite.
    """
    n = len(right)
    for k in range(n):
        for j in range(k):
            matrix[k, k] -= matrix[k, j] ** 2
        if not matrix[k, k] > 0.0:
            return np.zeros(n)
        matrix[k, k] = np.sqrt(matrix[k, k])
        for i in range(k + 1, n):
            for j in range(k):
                matrix[i, k] -= matrix[i, j] * matrix[k, j]
            matrix[i, k] /= matrix[k, k]
    x = right.copy()
    for i in range(n):
        for j in range(i):
            x[i] -= matrix[i, j] * x[j]
        x[i] /= matrix[i, i]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            x[i] -= matrix[j, i] * x[j]
        x[i] /= matrix[i, i]
    return x
