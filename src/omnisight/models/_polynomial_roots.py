"""Positive real roots of polynomials."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def first_positive_root(coefficients: Sequence[float]) -> float:
    """Return the smallest positive root of a polynomial, coefficients from the constant up; inf if none."""
    return float(positive_roots(coefficients).min(initial=np.inf))


def positive_roots(coefficients: Sequence[float]) -> Array:
    """Return the positive roots of a polynomial, coefficients from the constant up."""
    degree = len(coefficients) - 1
    while degree > 0 and coefficients[degree] == 0:
        degree -= 1
    if degree < 1:
        return np.empty(0)
    if degree == 1:
        return np.array([root] if (root := -coefficients[0] / coefficients[1]) > 0 else [])
    companion = np.eye(degree, k=-1)
    companion[0] -= np.array(coefficients[degree - 1 :: -1]) / coefficients[degree]
    roots = np.linalg.eigvals(companion)
    real = (np.abs(roots.imag) < 1e-9 * (1 + np.abs(roots))) & (roots.real > 0)
    return np.asarray(roots.real[real], float)
