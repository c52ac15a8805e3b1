"""Compiled epipolar residuals with their derivatives, and distances along bearings."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver
from omnisight.twoview._small_vectors_kernel import cross, dot, times, transposed_times


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
def distances(a, b, rotation, t):
    """Return what `epipolar.distances` does."""
    along_a, along_b, squared_chord = np.empty(len(a)), np.empty(len(a)), np.empty(len(a))
    for i in range(len(a)):
        p, q = times(rotation, a[i]), b[i]
        c = cross(p, q)
        squared_sine = dot(c, c)
        squared_chord[i] = (p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2
        if squared_sine > 0.0:
            along_a[i] = -dot(cross(t, q), c) / squared_sine
            along_b[i] = -dot(cross(t, p), c) / squared_sine
        else:
            along_a[i], along_b[i] = np.inf, np.inf
    return along_a, along_b, squared_chord
