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
    cross,
    dot,
    perpendiculars,
    quadratic_form,
    rotate_and_translate,
    times,
    transposed_times,
    whitened,
)
from omnisight.twoview.bearing_pairs import BearingPairs, isotropic_variance


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
        a, b = np.empty((2, 3)), np.empty((2, 3))
        for k in range(2):
            a[k], b[k] = problem.a[sample[k]], problem.b[sample[k]]
        return two_point_rotation(a, b, models)

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
        first_in_a, second_in_a = transposed_times(model, first), transposed_times(model, second)
        cov_a, cov_b = problem.covariance_a[i], problem.covariance_b[i]
        axes = whitened(
            first,
            second,
            quadratic_form(cov_b, first, first) + quadratic_form(cov_a, first_in_a, first_in_a),
            quadratic_form(cov_b, first, second) + quadratic_form(cov_a, first_in_a, second_in_a),
            quadratic_form(cov_b, second, second) + quadratic_form(cov_a, second_in_a, second_in_a),
        )
        for k in range(2):
            residual[k] = dot(axes[k], (p[0] - b[0], p[1] - b[1], p[2] - b[2]))
            jacobian[k, 0], jacobian[k, 1], jacobian[k, 2] = cross(p, axes[k])  # p changes by w x p
        return True

    @staticmethod
    def feature(problem, model, i):
        return 0.0

    @staticmethod
    def retract(problem, model, step):
        move = np.zeros(6)
        move[:3] = step
        rotate_and_translate(model, move)


class HomographyProblem(NamedTuple):
    """Pairs of bearings (N, 3) of points on a plane, with variances (N,) of each bearing along any direction.

    A step changes all elements of H but the largest.
    """

    a: Any
    b: Any
    variance_a: Any
    variance_b: Any

    @classmethod
    def of(cls, pairs: BearingPairs) -> "HomographyProblem":
        arrays = pairs.a, pairs.b, *map(isotropic_variance, (pairs.covariance_a, pairs.covariance_b))
        return cls(*map(np.ascontiguousarray, arrays))

    @staticmethod
    def sizes(problem):
        return 4, 1, 3, 8

    @staticmethod
    def solve_minimal(problem, sample, models):
        a, b, homographies = np.empty((4, 3)), np.empty((4, 3)), np.empty((1, 3, 3))
        for k in range(4):
            a[k], b[k] = problem.a[sample[k]], problem.b[sample[k]]
        count = four_point_homography(a, b, homographies)
        models[0, :, :3] = homographies[0]
        models[0, :, 3] = 0.0
        return count

    @staticmethod
    def squared_error(problem, model, i, j):
        direction, inverse = _direction(model, problem.a[i])
        b = problem.b[j]
        chord = (direction[0] - b[0]) ** 2 + (direction[1] - b[1]) ** 2 + (direction[2] - b[2]) ** 2
        return chord / _variance(problem, model, inverse, i, j)

    @staticmethod
    def linearize(problem, model, i, residual, jacobian):
        a, b = problem.a[i], problem.b[i]
        p, inverse = _direction(model, a)
        scale, largest = 1.0 / np.sqrt(_variance(problem, model, inverse, i, i)), _largest(model)
        for k in range(3):
            residual[k] = scale * (p[k] - b[k])
            column = 0
            for m in range(3):
                by_row = scale * inverse * ((1.0 if k == m else 0.0) - p[k] * p[m])
                for n in range(3):
                    if 3 * m + n != largest:
                        jacobian[k, column] = by_row * a[n]
                        column += 1
        return True

    @staticmethod
    def feature(problem, model, i):
        return 0.0

    @staticmethod
    def retract(problem, model, step):
        largest, column = _largest(model), 0
        for element in range(9):
            if element != largest:
                model[element // 3, element % 3] += step[column]
                column += 1
        model /= np.sqrt((model**2).sum() / 3.0)


@njit_helper
def _largest(model):
    """Return the index of the largest of nine elements."""
    best = 0
    for element in range(1, 9):
        if abs(model[element // 3, element % 3]) > abs(model[best // 3, best % 3]):
            best = element
    return best


@njit_helper
def _direction(model, a):
    """Return the direction of H a, and 1/|H a|."""
    x = times(model, a)
    inverse = 1.0 / max(np.sqrt(dot(x, x)), 1e-300)
    return (x[0] * inverse, x[1] * inverse, x[2] * inverse), inverse


@njit_helper
def _variance(problem, model, inverse, i, j):
    """Return the variance of a chord; the map of directions magnifies areas by |det H|/|H a|^3."""
    magnification = abs(dot(model[0], cross(model[1], model[2]))) * inverse**3
    return problem.variance_b[j] + magnification * problem.variance_a[i]
