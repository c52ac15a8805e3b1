"""Compiled problems of robust estimation in which bearings are mapped to bearings: a rotation, a plane's homography.

A model is [H | 0] (3, 4), and b is the direction p of H a; for a rotation, H = R.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

from typing import Any, NamedTuple

import numpy as np

from omnisight.compiled import njit_helper
from omnisight.twoview._alignment_kernel import two_point_rotation
from omnisight.twoview._homography_kernel import four_point_homography
from omnisight.twoview._small_vectors_kernel import (
    copy_elements,
    cross,
    dot,
    perpendiculars,
    quadratic_form,
    rotate,
    times,
    transposed_times,
    whitened,
)
from omnisight.twoview.bearing_pairs import BearingPairs


class RotationProblem(NamedTuple):
    """Pairs of bearings of two cameras in one place; a step is a rotation vector in frame b.

    Attributes
    ----------
    a, b
        (N, 3) unit bearings.
    covariance_a, covariance_b
        (N, 3, 3) covariances of the bearings, square radians.
    variance
        (N,) mean variance of the angle between a pair along any direction.
    """

    a: Any
    b: Any
    covariance_a: Any
    covariance_b: Any
    variance: Any

    @classmethod
    def of(cls, pairs: BearingPairs) -> "RotationProblem":
        arrays = pairs.a, pairs.b, pairs.covariance_a, pairs.covariance_b, pairs.variance
        return cls(*map(np.ascontiguousarray, arrays))

    @staticmethod
    def sizes(problem):
        return 2, 1, 2, 3

    @staticmethod
    def solve_minimal(problem, sample, models):
        return two_point_rotation(problem.a[sample], problem.b[sample], models)

    @staticmethod
    def squared_error(problem, model, i, j):
        p, b = times(model, problem.a[i]), problem.b[j]
        return ((p[0] - b[0]) ** 2 + (p[1] - b[1]) ** 2 + (p[2] - b[2]) ** 2) / problem.variance[i]

    @staticmethod
    def linearize(problem, model, i, residual, jacobian):
        p, b = times(model, problem.a[i]), problem.b[i]
        if dot(p, b) <= 0.0:
            return False
        first, second = perpendiculars(b)
        in_a = transposed_times(model, first), transposed_times(model, second)
        axes = _whitened_tangents(problem.covariance_b[i], first, second, problem.covariance_a[i], in_a)
        for k in range(2):
            residual[k] = dot(axes[k], (p[0] - b[0], p[1] - b[1], p[2] - b[2]))
            jacobian[k, 0], jacobian[k, 1], jacobian[k, 2] = cross(p, axes[k])  # p changes by w x p
        return True

    @staticmethod
    def retract(problem, model, step):
        rotate(model, step)


class HomographyProblem(NamedTuple):
    """Pairs of bearings of points on a plane; a step changes all elements of H but the largest.

    Attributes
    ----------
    a, b
        (N, 3) unit bearings.
    covariance_a, covariance_b
        (N, 3, 3) covariances of the bearings, square radians.
    variance_a, variance_b
        (N,) mean variances of the bearings along any tangent direction, square radians.
    """

    a: Any
    b: Any
    covariance_a: Any
    covariance_b: Any
    variance_a: Any
    variance_b: Any

    @classmethod
    def of(cls, pairs: BearingPairs) -> "HomographyProblem":
        return cls(*pairs.arrays)

    @staticmethod
    def sizes(problem):
        return 4, 1, 2, 8

    @staticmethod
    def solve_minimal(problem, sample, models):
        homographies = np.empty((1, 3, 3))
        count = four_point_homography(problem.a[sample], problem.b[sample], homographies)
        copy_elements(models[0], homographies[0])
        models[0, :, 3] = 0.0
        return count

    @staticmethod
    def squared_error(problem, model, i, j):
        p, inverse = _direction(model, problem.a[i])
        b = problem.b[j]
        chord = (p[0] - b[0]) ** 2 + (p[1] - b[1]) ** 2 + (p[2] - b[2]) ** 2
        # The map of directions magnifies areas by |det H|/|H a|^3.
        magnification = abs(dot(model[0], cross(model[1], model[2]))) * inverse**3
        return chord / (problem.variance_b[j] + magnification * problem.variance_a[i])

    @staticmethod
    def linearize(problem, model, i, residual, jacobian):
        a, b = problem.a[i], problem.b[i]
        p, inverse = _direction(model, a)
        if dot(p, b) <= 0.0:
            return False
        first, second = perpendiculars(b)
        first_by_x, second_by_x = _direction_gradient(p, inverse, first), _direction_gradient(p, inverse, second)
        in_a = transposed_times(model, first_by_x), transposed_times(model, second_by_x)
        axes = _whitened_tangents(problem.covariance_b[i], first, second, problem.covariance_a[i], in_a)
        largest = _largest(model)
        for k in range(2):
            residual[k] = dot(axes[k], p)
            by_x, column = _direction_gradient(p, inverse, axes[k]), 0
            for element in range(9):
                if element != largest:
                    jacobian[k, column] = by_x[element // 3] * a[element % 3]
                    column += 1
        return True

    @staticmethod
    def retract(problem, model, step):
        largest, column = _largest(model), 0
        for element in range(9):
            if element != largest:
                model[element // 3, element % 3] += step[column]
                column += 1
        model /= np.sqrt((model**2).sum() / 3.0)


@njit_helper
def _whitened_tangents(covariance_b, first, second, covariance_a, in_a):
    """Return vectors in frame b along which the sum of both noises is white, given two tangents in both frames."""
    return whitened(
        first,
        second,
        quadratic_form(covariance_b, first, first) + quadratic_form(covariance_a, in_a[0], in_a[0]),
        quadratic_form(covariance_b, first, second) + quadratic_form(covariance_a, in_a[0], in_a[1]),
        quadratic_form(covariance_b, second, second) + quadratic_form(covariance_a, in_a[1], in_a[1]),
    )


@njit_helper
def _largest(model):
    """Return the index of the largest of nine elements."""
    best, largest = 0, 0.0
    for element in range(9):
        size = abs(model[element // 3, element % 3])
        if size > largest:
            best, largest = element, size
    return best


@njit_helper
def _direction(model, a):
    """Return the direction of H a, and 1/|H a|."""
    x = times(model, a)
    inverse = 1.0 / max(np.sqrt(dot(x, x)), 1e-300)
    return (x[0] * inverse, x[1] * inverse, x[2] * inverse), inverse


@njit_helper
def _direction_gradient(p, inverse, axis):
    """Return the derivative of axis . x/|x| by x, given the direction p of x and 1/|x|."""
    along = dot(axis, p)
    return inverse * (axis[0] - along * p[0]), inverse * (axis[1] - along * p[1]), inverse * (axis[2] - along * p[2])
