"""Compiled epipolar residuals with their derivatives, and the test of positive distances."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver, njit_helper
from omnisight.twoview._small_vectors_kernel import cross, dot, times, transposed_times

# Squared parallax in units of its variance below which the sign of a distance is noise.
MIN_SQUARED_PARALLAX = 9.0


@njit_driver
def residuals_and_derivatives(a, b, covariance_a, covariance_b, rotation, t):
    """Return what `epipolar.epipolar_residuals` does."""
    residuals, jacobian = np.empty(len(a)), np.empty((len(a), 6))
    for i in range(len(a)):
        p, q = times(rotation, a[i]), b[i]
        m, n = cross(t, p), cross(t, q)
        across_b = times(covariance_b[i], m)
        across_a = times(rotation, times(covariance_a[i], transposed_times(rotation, n)))
        variance = max(dot(m, across_b) + dot(n, across_a), 1e-300)
        sigma, residual = np.sqrt(variance), dot(q, m)
        # A step (w, v) changes p by w x p and t by v: e by w . (n x p) + v . (p x q), and half the variance likewise.
        by_w, by_v = cross(n, p), cross(p, q)
        first, second = cross(p, cross(across_b, t)), cross(n, across_a)
        third, fourth = cross(p, across_b), cross(q, across_a)
        relative = residual / variance
        for k in range(3):
            jacobian[i, k] = (by_w[k] - relative * (first[k] - second[k])) / sigma
            jacobian[i, 3 + k] = (by_v[k] - relative * (third[k] + fourth[k])) / sigma
        residuals[i] = residual / sigma
    return residuals, jacobian


@njit_driver
def behind(a, b, variance, rotation, t):
    """Return what `epipolar.is_behind` does."""
    result = np.empty(len(a), np.bool_)
    for i in range(len(a)):
        p, q = times(rotation, a[i]), b[i]
        result[i] = is_behind(p, q, cross(t, p), cross(t, q), variance[i])
    return result


@njit_helper
def is_behind(p, q, m, n, variance):
    """Return whether a distance along p or q is negative, although the parallax is larger than its noise.

    With m = t x p, n = t x q and c = p x q, the distances are -n . c/|c|^2 and -m . c/|c|^2. The length of the chord
    between p and q is that of the parallax, and 2 for opposite bearings, whose c is zero.
    """
    c = cross(p, q)
    squared_chord = (p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2
    return (dot(n, c) > 0.0 or dot(m, c) > 0.0) and squared_chord > MIN_SQUARED_PARALLAX * variance
