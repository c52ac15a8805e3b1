"""Compiled absolute pose of a camera from bearings of known points: the problem of robust estimation.

A model is [R | t] (3, 4), and the point X has the direction p along R X + t.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

from typing import Any, NamedTuple

import numpy as np

from omnisight.compiled import njit_helper
from omnisight.twoview._p3p_kernel import p3p
from omnisight.twoview._small_vectors_kernel import (
    cross,
    dot,
    perpendiculars,
    quadratic_form,
    rotate_and_translate,
    times,
    whitened,
)


class AbsolutePoseProblem(NamedTuple):
    """Bearings of known points; a step is that of `Pose.moved`. The share of outliers depends on the distance.

    Attributes
    ----------
    points
        (N, 3) points in the world frame.
    bearings
        (N, 3) unit bearings.
    covariance
        (N, 3, 3) covariances of the bearings, square radians.
    variance
        (N,) mean variances of each bearing along any tangent direction, square radians.
    """

    points: Any
    bearings: Any
    covariance: Any
    variance: Any

    @staticmethod
    def sizes(problem):
        return 3, 4, 2, 6

    @staticmethod
    def solve_minimal(problem, sample, models):
        return p3p(problem.points[sample], problem.bearings[sample], models)

    @staticmethod
    def squared_error(problem, model, i, j):
        (x, y, z), _ = direction(times(model, problem.points[i]), model[:, 3])
        b = problem.bearings[j]
        return ((x - b[0]) ** 2 + (y - b[1]) ** 2 + (z - b[2]) ** 2) / problem.variance[j]

    @staticmethod
    def linearize(problem, model, i, residual, jacobian):
        rotated, b, covariance = times(model, problem.points[i]), problem.bearings[i], problem.covariance[i]
        p, inverse = direction(rotated, model[:, 3])
        if dot(p, b) <= 0.0:
            return False
        first, second = perpendiculars(b)
        axes = whitened(
            first,
            second,
            quadratic_form(covariance, first, first),
            quadratic_form(covariance, first, second),
            quadratic_form(covariance, second, second),
        )
        for k in range(2):
            residual[k] = dot(axes[k], (p[0] - b[0], p[1] - b[1], p[2] - b[2]))
            by_w, by_v = derivatives_along(axes[k], p, inverse, rotated)
            jacobian[k, 0], jacobian[k, 1], jacobian[k, 2] = by_w
            jacobian[k, 3], jacobian[k, 4], jacobian[k, 5] = by_v
        return True

    @staticmethod
    def feature(problem, model, i):
        _, inverse = direction(times(model, problem.points[i]), model[:, 3])
        return 1.0 / inverse

    @staticmethod
    def retract(problem, model, step):
        rotate_and_translate(model, step)


@njit_helper
def direction(rotated, translation):
    """Return the direction p of R X + t, given R X, and 1/|R X + t|."""
    x, y, z = rotated[0] + translation[0], rotated[1] + translation[1], rotated[2] + translation[2]
    inverse = 1.0 / max(np.sqrt(x * x + y * y + z * z), 1e-300)
    return (x * inverse, y * inverse, z * inverse), inverse


@njit_helper
def derivatives_along(axis, p, inverse, rotated):
    """Return the derivatives of axis . p by a step (w, v) of the pose: dp = (I - p p^T)(w x (R X) + v)/|R X + t|."""
    along = dot(axis, p)
    by_v = inverse * (axis[0] - along * p[0]), inverse * (axis[1] - along * p[1]), inverse * (axis[2] - along * p[2])
    return cross(rotated, by_v), by_v
