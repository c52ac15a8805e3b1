"""Real roots of polynomials, compared with the eigenvalues of the companion matrix."""

import numpy as np
import pytest

from omnisight.optim._polynomial_kernel import real_roots


def found_roots(coefficients):
    roots = np.empty(len(coefficients) - 1)
    return np.sort(roots[: real_roots(np.asarray(coefficients, float), roots)])


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


@pytest.mark.parametrize("coefficients", [[1.0, 0.0, 1.0], [2.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, np.nan, 1.0]])
def test_a_polynomial_without_real_roots_has_none(coefficients):
    assert found_roots(coefficients).size == 0
