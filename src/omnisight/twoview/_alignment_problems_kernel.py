"""Compiled problems of RANSAC whose bearings are mapped to bearings: a rotation, and the homography of a plane.

A model is [H | 0] (3, 4), and b is the direction p of H a; for a rotation, H = R.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

from typing import Any, NamedTuple

import numpy as np

from omnisight.compiled import njit_helper
from omnisight.optim._cholesky_kernel import solve_symmetric
from omnisight.twoview._alignment_kernel import two_point_rotation
from omnisight.twoview._homography_kernel import four_point_homography
from omnisight.twoview._small_vectors_kernel import cross, dot, rotate_and_translate, times

# Gauss-Newton steps per round of reweighting.
STEPS = 2


class CompiledRotation(NamedTuple):
    """Pairs of bearings of two cameras in one place; `variance` (N,) is that of the angle between a pair."""

    a: Any
    b: Any
    variance: Any

    @staticmethod
    def solve_minimal(problem, sample, models):
        """Fill models (1, 3, 4) with the rotation of a sample (2,)."""
        a, b = np.empty((2, 3)), np.empty((2, 3))
        for k in range(2):
            a[k], b[k] = problem.a[sample[k]], problem.b[sample[k]]
        return two_point_rotation(a, b, models)

    @staticmethod
    def squared_error(problem, model, i):
        """Return the squared chord between R a and b over its variance."""
        p, b = times(model, problem.a[i]), problem.b[i]
        return ((p[0] - b[0]) ** 2 + (p[1] - b[1]) ** 2 + (p[2] - b[2]) ** 2) / problem.variance[i]

    @staticmethod
    def refined(problem, model, weights):
        """Return a rotation after Gauss-Newton steps on the weighted chords."""
        hessian, step = np.empty((3, 3)), np.zeros(6)
        for _ in range(STEPS):
            hessian[:] = 0.0
            gradient = np.zeros(3)
            for i in range(len(weights)):
                # p changes by w x p: the normal equations are sum (I - p p^T) w = sum p x b.
                weight, p = weights[i] / problem.variance[i], times(model, problem.a[i])
                c = cross(p, problem.b[i])
                for r in range(3):
                    gradient[r] += weight * c[r]
                    for s in range(3):
                        hessian[r, s] += weight * ((1.0 if r == s else 0.0) - p[r] * p[s])
            step[:3] = solve_symmetric(hessian, gradient)
            rotate_and_translate(model, step)
        return model


class CompiledHomography(NamedTuple):
    """Pairs of bearings (N, 3) of points on a plane, with variances (N,) of each bearing along any direction."""

    a: Any
    b: Any
    variance_a: Any
    variance_b: Any

    @staticmethod
    def solve_minimal(problem, sample, models):
        """Fill models (1, 3, 4) with the homography of a sample (4,)."""
        a, b, homographies = np.empty((4, 3)), np.empty((4, 3)), np.empty((1, 3, 3))
        for k in range(4):
            a[k], b[k] = problem.a[sample[k]], problem.b[sample[k]]
        count = four_point_homography(a, b, homographies)
        models[0, :, :3] = homographies[0]
        models[0, :, 3] = 0.0
        return count

    @staticmethod
    def squared_error(problem, model, i):
        """Return the squared chord between the direction of H a and b over its variance."""
        direction, inverse = _direction(model, problem.a[i])
        b = problem.b[i]
        chord = (direction[0] - b[0]) ** 2 + (direction[1] - b[1]) ** 2 + (direction[2] - b[2]) ** 2
        return chord / _variance(problem, model, inverse, i)

    @staticmethod
    def refined(problem, model, weights):
        """Return a homography after Gauss-Newton steps on the weighted chords, at fixed variances."""
        hessian, gradient, row = np.empty((9, 9)), np.empty(9), np.empty(9)
        for _ in range(STEPS):
            # The residuals do not depend on the scale of H: its direction gets any positive eigenvalue.
            for r in range(9):
                gradient[r] = 0.0
                for s in range(9):
                    hessian[r, s] = model[r // 3, r % 3] * model[s // 3, s % 3]
            for i in range(len(weights)):
                a, b = problem.a[i], problem.b[i]
                p, inverse = _direction(model, a)
                weight = weights[i] / _variance(problem, model, inverse, i)
                for k in range(3):
                    for m in range(3):
                        for n in range(3):
                            row[3 * m + n] = ((1.0 if k == m else 0.0) - p[k] * p[m]) * a[n] * inverse
                    for r in range(9):
                        gradient[r] -= weight * (p[k] - b[k]) * row[r]
                        for s in range(r + 1):
                            hessian[r, s] += weight * row[r] * row[s]
            model[:, :3] += solve_symmetric(hessian, gradient).reshape(3, 3)
            model /= np.sqrt((model**2).sum() / 3.0)
        return model


@njit_helper
def _direction(model, a):
    """Return the direction of H a, and 1/|H a|."""
    x = times(model, a)
    inverse = 1.0 / max(np.sqrt(dot(x, x)), 1e-300)
    return (x[0] * inverse, x[1] * inverse, x[2] * inverse), inverse


@njit_helper
def _variance(problem, model, inverse, i):
    """Return the variance of a chord; the map of directions magnifies areas by |det H|/|H a|^3."""
    magnification = abs(dot(model[0], cross(model[1], model[2]))) * inverse**3
    return problem.variance_b[i] + magnification * problem.variance_a[i]
