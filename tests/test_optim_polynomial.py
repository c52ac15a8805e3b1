"""Real roots of polynomials, compared with the eigenvalues of the companion matrix."""

import numpy as np
import pytest
from numba import njit

from omnisight.optim._polynomial_kernel import real_roots


@njit
def roots_of(coefficients):
    roots = np.empty(len(coefficients) - 1)
    return roots[: real_roots(coefficients, roots)]


def found_roots(coefficients):
    return np.sort(roots_of(np.asarray(coefficients, float)))


@pytest.mark.parametrize("degree", [1, 2, 3, 4, 8, 10])
def test_the_real_roots_are_those_of_the_companion_matrix(degree):
    rng = np.random.default_rng(degree)
    found = 0
    for _ in range(100):
        coefficients = rng.normal(size=degree + 1)
        every = np.roots(coefficients[::-1])
        expected = np.sort(every.real[np.abs(every.imag) < 1e-9 * np.abs(every)])
        roots = found_roots(coefficients)
        np.testing.assert_allclose(roots, expected, rtol=1e-8)
        found += len(roots)
    assert found >= 50


def test_roots_of_very_different_size_are_found():
    coefficients = np.polynomial.polynomial.polyfromroots([-1e5, -2.0, 1e-4, 0.5, 30.0])
    np.testing.assert_allclose(found_roots(coefficients), [-1e5, -2.0, 1e-4, 0.5, 30.0], rtol=1e-9)


@pytest.mark.parametrize("roots", [[0.0], [1.0], [-1.0], [-1.0, 0.0, 1.0], [-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0]])
def test_roots_at_the_ends_of_the_intervals_are_found_once(roots):
    np.testing.assert_allclose(found_roots(np.polynomial.polynomial.polyfromroots(roots)), roots, rtol=0, atol=1e-15)


@pytest.mark.parametrize("gap", [1e-2, 1e-4, 1e-6])
def test_neighbouring_roots_are_separated(gap):
    roots = [-3.0, 0.3, 0.3 + gap, 2.0]
    found = found_roots(np.polynomial.polynomial.polyfromroots(roots))
    np.testing.assert_allclose(found, roots, rtol=0, atol=1e-14 / gap)


def test_ten_real_roots_are_found():
    roots = np.arange(1.0, 11.0)
    np.testing.assert_allclose(found_roots(np.polynomial.polynomial.polyfromroots(roots)), roots, rtol=1e-7)


@pytest.mark.parametrize("coefficients", [[1.0, 0.0, 1.0], [2.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, np.nan, 1.0]])
def test_a_polynomial_without_real_roots_has_none(coefficients):
    assert found_roots(coefficients).size == 0
