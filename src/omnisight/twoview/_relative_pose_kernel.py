"""Compiled relative pose of two cameras from bearings: the problem of robust estimation.

A model is [R | t] (3, 4), with x_b = R x_a + t and |t| = 1. With p = R a, q = b, m = t x p and n = t x q, the epipolar
residual is e = q . m. Its variance is m^T S_b m + n^T S_a n, with both covariances in frame b: the squared quotient is,
to first order, the least sum of squared corrections of both bearings that makes them meet (P. Sampson, 1982; Hartley
and Zisserman, ch. 11.4).
"""

# Compiled code takes its types from its arguments.
# pyright: basic

from typing import Any, NamedTuple

import numpy as np

from omnisight.compiled import njit_helper
from omnisight.twoview._five_point_kernel import five_point
from omnisight.twoview._small_vectors_kernel import (
    cross,
    dot,
    perpendiculars,
    rotate,
    times,
    transposed_times,
)
from omnisight.twoview.bearing_pairs import BearingPairs

# Squared parallax in units of its variance below which the sign of a distance is noise.
MIN_SQUARED_PARALLAX = 9.0


class RelativePoseProblem(NamedTuple):
    """Pairs of bearings of two cameras.

    A step is a rotation vector in frame b, and two components of the translation along `perpendiculars` of it. The
    share of outliers depends on the distance of the point, since unrelated bearings mostly meet near the cameras. The
    feature is the inverse of its square: the squared parallax over the squared sines of the angles to the translation,
    without noise.

    The second bearing of an outlier can be anywhere on the half of a circle around the first one where both distances
    are positive. With the radius L, in standard deviations of the residual, the density of the residual L sin(psi) near
    zero is 1/(pi L), and for a small L that of an inlier. Of p and q, the circle is around the one nearer to the
    translation. For forward motion in 60 degrees with 70 % outliers, the squared error of the pose was 1.36 of its
    covariance with the same density for all pairs, and is 1.03 with this one.

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
    def of(cls, pairs: BearingPairs) -> "RelativePoseProblem":
        return cls(*pairs.arrays)

    @staticmethod
    def sizes(problem):
        return 5, 10, 1, 5

    @staticmethod
    def solve_minimal(problem, sample, models):
        return five_point(problem.a[sample], problem.b[sample], models)

    @staticmethod
    def squared_error(problem, model, i, j):
        p, q, t = times(model, problem.a[i]), problem.b[j], (model[0, 3], model[1, 3], model[2, 3])
        m, n = cross(t, p), cross(t, q)
        variance_a, variance_b = problem.variance_a[i], problem.variance_b[j]
        square = dot(q, m) ** 2 / max(variance_b * dot(m, m) + variance_a * dot(n, n), 1e-300)
        return np.inf if _is_behind(p, q, m, n, variance_a + variance_b) else square

    @staticmethod
    def linearize(problem, model, i, residual, jacobian):
        p, q, t = times(model, problem.a[i]), problem.b[i], (model[0, 3], model[1, 3], model[2, 3])
        m, n = cross(t, p), cross(t, q)
        if _is_behind(p, q, m, n, problem.variance_a[i] + problem.variance_b[i]):
            return False
        across_a = times(model, times(problem.covariance_a[i], transposed_times(model, n)))
        across_b = times(problem.covariance_b[i], m)
        variance = max(dot(m, across_b) + dot(n, across_a), 1e-300)
        sigma, e = np.sqrt(variance), dot(q, m)
        residual[0], relative = e / sigma, e / variance
        # A step (w, v) changes p by w x p and t by v: e by w . (n x p) + v . (p x q), and half the variance likewise.
        by_w, by_v = cross(n, p), cross(p, q)
        first, second = cross(p, cross(across_b, t)), cross(n, across_a)
        third, fourth = cross(p, across_b), cross(q, across_a)
        for k in range(3):
            jacobian[0, k] = (by_w[k] - relative * (first[k] - second[k])) / sigma
        by_v = (
            by_v[0] - relative * (third[0] + fourth[0]),
            by_v[1] - relative * (third[1] + fourth[1]),
            by_v[2] - relative * (third[2] + fourth[2]),
        )
        along = perpendiculars(t)
        for k in range(2):
            jacobian[0, 3 + k] = dot(along[k], by_v) / sigma
        return True

    @staticmethod
    def feature(problem, model, i):
        p, q, t = times(model, problem.a[i]), problem.b[i], (model[0, 3], model[1, 3], model[2, 3])
        m, n = cross(t, p), cross(t, q)
        return _squared_chord(p, q) / max(dot(m, m) + dot(n, n), 1e-300)

    @staticmethod
    def outlier_density(problem, model, i, scale, measured):
        p, q, t = times(model, problem.a[i]), problem.b[i], (model[0, 3], model[1, 3], model[2, 3])
        m, n = cross(t, p), cross(t, q)
        squared_m, squared_n = dot(m, m), dot(n, n)
        variance = problem.variance_b[i] * squared_m + problem.variance_a[i] * squared_n
        square = _squared_chord(p, q) * min(squared_m, squared_n) / max(variance, 1e-300)
        return 1.0 / np.sqrt(2.0 * np.pi * scale**2 + np.pi**2 * square)

    @staticmethod
    def retract(problem, model, step):
        rotate(model, (step[0], step[1], step[2]))
        t = model[0, 3], model[1, 3], model[2, 3]
        first, second = perpendiculars(t)
        # The length of t + v for v perpendicular to the unit vector t.
        length = np.sqrt(dot(t, t) + step[3] ** 2 + step[4] ** 2)
        for k in range(3):
            model[k, 3] = (t[k] + step[3] * first[k] + step[4] * second[k]) / length


@njit_helper
def _is_behind(p, q, m, n, variance):
    """Return whether a distance along p or q is negative, although the parallax is larger than its noise.

    With c = p x q, the distances are -n . c/|c|^2 and -m . c/|c|^2. The length of the chord between p and q is that of
    the parallax, and 2 for opposite bearings, whose c is zero.
    """
    c = cross(p, q)
    return ((dot(n, c) > 0.0) | (dot(m, c) > 0.0)) & (_squared_chord(p, q) > MIN_SQUARED_PARALLAX * variance)


@njit_helper
def _squared_chord(p, q):
    """Return |p - q|^2."""
    return (p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2
