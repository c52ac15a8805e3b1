"""Compiled relative pose of two cameras from bearings: the problem of RANSAC.

A model is [R | t] (3, 4), with x_b = R x_a + t and |t| = 1. With p = R a and q = b, the epipolar residual is
e = q . (t x p). Its variance for bearings with isotropic variances s_a, s_b is s_b |t x p|^2 + s_a |t x q|^2.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

from typing import Any, NamedTuple

import numpy as np

from omnisight.compiled import njit_helper
from omnisight.optim._cholesky_kernel import solve_symmetric
from omnisight.twoview._epipolar_kernel import is_behind
from omnisight.twoview._five_point_kernel import five_point
from omnisight.twoview._small_vectors_kernel import cross, dot, rotate_and_translate, times

# Gauss-Newton steps per round of reweighting.
STEPS = 2


class CompiledRelativePose(NamedTuple):
    """Pairs of bearings of two cameras.

    Attributes
    ----------
    a, b
        (N, 3) unit bearings.
    variance_a, variance_b
        (N,) variances of each bearing along any tangent direction, square radians.
    """

    a: Any
    b: Any
    variance_a: Any
    variance_b: Any

    @staticmethod
    def solve_minimal(problem, sample, models):
        """Fill models (10, 3, 4) with the poses in which all bearings of a sample (5,) have positive distances."""
        a, b = np.empty((5, 3)), np.empty((5, 3))
        for k in range(5):
            a[k], b[k] = problem.a[sample[k]], problem.b[sample[k]]
        return five_point(a, b, models)

    @staticmethod
    def squared_error(problem, model, i):
        """Return the squared epipolar residual of a pair over its variance; inf for a point behind a camera."""
        p, q, t = times(model, problem.a[i]), problem.b[i], (model[0, 3], model[1, 3], model[2, 3])
        m, n = cross(t, p), cross(t, q)
        variance_a, variance_b = problem.variance_a[i], problem.variance_b[i]
        if is_behind(p, q, m, n, variance_a + variance_b):
            return np.inf
        return dot(q, m) ** 2 / max(variance_b * dot(m, m) + variance_a * dot(n, n), 1e-300)

    @staticmethod
    def refined(problem, model, weights):
        """Return a pose after Gauss-Newton steps on the weighted epipolar residuals, at fixed variances."""
        jacobian, gradient, hessian, step = np.empty(5), np.empty(5), np.empty((5, 5)), np.empty(6)
        for _ in range(STEPS):
            tangents = _tangents(model)
            gradient[:] = 0.0
            hessian[:] = 0.0
            for i in range(len(weights)):
                if weights[i] == 0.0:
                    continue
                residual = _residual(problem, model, tangents, i, jacobian)
                for r in range(5):
                    gradient[r] -= weights[i] * residual * jacobian[r]
                    for c in range(r + 1):
                        hessian[r, c] += weights[i] * jacobian[r] * jacobian[c]
            solution = solve_symmetric(hessian, gradient)
            step[:3] = solution[:3]
            step[3:] = solution[3] * tangents[0] + solution[4] * tangents[1]
            rotate_and_translate(model, step)
            model[:, 3] /= np.sqrt((model[:, 3] ** 2).sum())
        return model


@njit_helper
def _tangents(model):
    """Return two unit vectors (2, 3) perpendicular to the translation."""
    t, axis = model[:, 3].copy(), np.zeros(3)
    axis[np.argmin(np.abs(t))] = 1.0
    tangents = np.empty((2, 3))
    tangents[0] = np.cross(t, axis)
    tangents[0] /= np.sqrt((tangents[0] ** 2).sum())
    tangents[1] = np.cross(t, tangents[0])
    return tangents


@njit_helper
def _residual(problem, model, tangents, i, jacobian):
    """Return the residual of a pair over its standard deviation; fill its derivatives (5,) by the steps of a pose."""
    p, q, t = times(model, problem.a[i]), problem.b[i], (model[0, 3], model[1, 3], model[2, 3])
    m, n, c = cross(t, p), cross(t, q), cross(p, q)
    variance = problem.variance_b[i] * dot(m, m) + problem.variance_a[i] * dot(n, n)
    scale = 1.0 / np.sqrt(max(variance, 1e-300))
    # A rotation w changes p by w x p, and e by w . (n x p); a step v of t changes e by v . (p x q).
    by_rotation = cross(n, p)
    for k in range(3):
        jacobian[k] = scale * by_rotation[k]
    for k in range(2):
        jacobian[3 + k] = scale * dot(tangents[k], c)
    return scale * dot(q, m)
