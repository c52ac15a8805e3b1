"""Compiled absolute pose of a camera from bearings of known points: the problem of RANSAC, residuals and derivatives.

A model is [R | t] (3, 4), and the point X has the direction p along R X + t.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

from typing import Any, NamedTuple

import numpy as np

from omnisight.compiled import njit_driver, njit_helper
from omnisight.optim._cholesky_kernel import solve_symmetric
from omnisight.twoview._p3p_kernel import p3p
from omnisight.twoview._small_vectors_kernel import cross, dot, rotate_and_translate, times

# Gauss-Newton steps per round of reweighting.
STEPS = 2


class CompiledAbsolutePose(NamedTuple):
    """Bearings of known points.

    Attributes
    ----------
    points
        (N, 3) points in the world frame.
    bearings
        (N, 3) unit bearings.
    variance
        (N,) variances of each bearing along any tangent direction, square radians.
    """

    points: Any
    bearings: Any
    variance: Any

    @staticmethod
    def solve_minimal(problem, sample, models):
        """Fill models (4, 3, 4) with the poses in which the points of a sample (3,) lie along the bearings."""
        points, bearings = np.empty((3, 3)), np.empty((3, 3))
        for k in range(3):
            points[k], bearings[k] = problem.points[sample[k]], problem.bearings[sample[k]]
        return p3p(points, bearings, models)

    @staticmethod
    def squared_error(problem, model, i):
        """Return the squared chord between a bearing and the direction of its point over its variance."""
        direction, _ = _direction(model, problem.points[i])
        x, y, z = direction
        b = problem.bearings[i]
        return ((x - b[0]) ** 2 + (y - b[1]) ** 2 + (z - b[2]) ** 2) / problem.variance[i]

    @staticmethod
    def refined(problem, model, weights):
        """Return a pose after Gauss-Newton steps on the weighted chords."""
        jacobian, gradient, hessian = np.empty((3, 6)), np.empty(6), np.empty((6, 6))
        for _ in range(STEPS):
            gradient[:] = 0.0
            hessian[:] = 0.0
            for i in range(len(weights)):
                if weights[i] == 0.0:
                    continue
                direction, _ = direction_and_derivatives(model, problem.points[i], jacobian)
                weight = weights[i] / problem.variance[i]
                for k in range(3):
                    chord = weight * (direction[k] - problem.bearings[i, k])
                    for r in range(6):
                        gradient[r] -= chord * jacobian[k, r]
                        for c in range(r + 1):
                            hessian[r, c] += weight * jacobian[k, r] * jacobian[k, c]
            step = solve_symmetric(hessian, gradient)
            rotate_and_translate(model, step)
        return model


@njit_helper
def _direction(model, point):
    """Return the direction of a point, and its rotated coordinates over the distance."""
    x, y, z = times(model, point)
    a, b, c = x + model[0, 3], y + model[1, 3], z + model[2, 3]
    inverse = 1.0 / max(np.sqrt(a * a + b * b + c * c), 1e-300)
    return (a * inverse, b * inverse, c * inverse), inverse


@njit_helper
def direction_and_derivatives(model, point, jacobian):
    """Return the direction p of a point and 1/|R X + t|; fill dp (3, 6) by a step (w, v) of `Pose.moved`.

    With y = R X: dp = (I - p p^T)(w x y + v)/|y + t|.
    """
    y = times(model, point)
    direction, inverse = _direction(model, point)
    for i in range(3):
        for j in range(3):
            jacobian[i, 3 + j] = ((1.0 if i == j else 0.0) - direction[i] * direction[j]) * inverse
        row = jacobian[i, 3], jacobian[i, 4], jacobian[i, 5]
        jacobian[i, 0], jacobian[i, 1], jacobian[i, 2] = cross(y, row)
    return direction, inverse


@njit_driver
def residuals_and_derivatives(points, bearings, whitening, model):
    """Return residuals (N, 2), NaN for points behind the bearing, and their derivatives (N, 2, 6).

    `whitening` (N, 2, 3) maps a chord to its components in the tangent plane over their standard deviations.
    """
    count = len(points)
    residuals, derivatives, jacobian = np.empty((count, 2)), np.empty((count, 2, 6)), np.empty((3, 6))
    for i in range(count):
        p, _ = direction_and_derivatives(model, points[i], jacobian)
        b = bearings[i]
        is_behind = dot(p, b) <= 0.0
        chord = p[0] - b[0], p[1] - b[1], p[2] - b[2]
        for k in range(2):
            residuals[i, k] = np.nan if is_behind else dot(whitening[i, k], chord)
            for j in range(6):
                column = jacobian[0, j], jacobian[1, j], jacobian[2, j]
                derivatives[i, k, j] = dot(whitening[i, k], column)
    return residuals, derivatives
