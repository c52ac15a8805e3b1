"""Eigenvalues and eigenvectors of small symmetric matrices, compared with LAPACK."""

import numpy as np
import pytest
from numba import njit

from omnisight.optim import _eigen_kernel as kernel

pseudo_inverse = njit(lambda matrix: kernel.pseudo_inverse(matrix))


@njit
def eigen(matrix):
    values, vectors = np.empty(len(matrix)), np.empty(matrix.shape)
    kernel.symmetric_eigen(matrix.copy(), values, vectors)
    return values, vectors


@pytest.mark.parametrize("size", [1, 2, 3, 9])
def test_the_eigenvalues_are_those_of_lapack(size):
    rng = np.random.default_rng(size)
    for scale in (1e-8, 1.0, 1e8):
        factor = rng.normal(size=(size, size)) * np.logspace(0, 3, size)
        matrix = scale * factor.T @ factor
        values, vectors = eigen(matrix)
        largest = np.abs(matrix).max()
        np.testing.assert_allclose(values, np.linalg.eigvalsh(matrix), rtol=0, atol=1e-13 * largest)
        np.testing.assert_allclose(vectors @ vectors.T, np.eye(size), rtol=0, atol=1e-13)
        np.testing.assert_allclose(vectors.T * values @ vectors, matrix, rtol=0, atol=1e-13 * largest)


@pytest.mark.parametrize("rank", [0, 1, 3, 5])
def test_the_pseudo_inverse_is_that_of_lapack(rank):
    rng = np.random.default_rng(rank)
    factor = rng.normal(size=(rank, 5))
    matrix = factor.T @ factor
    expected = np.linalg.pinv(matrix, rcond=1e-14, hermitian=True)
    np.testing.assert_allclose(pseudo_inverse(matrix), expected, rtol=1e-9, atol=1e-12)


def test_equal_eigenvalues_have_orthonormal_eigenvectors():
    values, vectors = eigen(3.0 * np.eye(3))
    np.testing.assert_array_equal(values, 3.0)
    np.testing.assert_array_equal(vectors, np.eye(3))


@pytest.mark.parametrize("matrix", [np.zeros((3, 3)), np.ones((3, 3)), np.full((3, 3), np.nan)])
def test_a_singular_matrix_or_one_with_nan_ends(matrix):
    values, _ = eigen(matrix)
    np.testing.assert_allclose(values[:2], matrix[0, 0] - matrix[0, 1], atol=1e-15)
