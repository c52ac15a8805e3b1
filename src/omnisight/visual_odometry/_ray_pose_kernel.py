"""Compiled pose of a rig, or of any camera, from rays of known points: the problem of robust estimation.

A model is rig_from_world = [R | t] (3, 4): the point X is in the direction of R X + t - o from the origin o of its ray.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

from typing import Any, NamedTuple

import numpy as np

from omnisight.compiled import njit_helper
from omnisight.twoview._absolute_pose_kernel import derivatives_along
from omnisight.twoview._gp3p_kernel import gp3p
from omnisight.twoview._p3p_kernel import p3p
from omnisight.twoview._small_vectors_kernel import dot, rotate_and_translate, times


class RayPoseProblem(NamedTuple):
    """Rays of known points; a step is that of `Pose.moved`. The share of outliers depends on the distance.

    Attributes
    ----------
    points
        (N, 3) points in the world.
    origins, bearings
        (N, 3) of the rays in the frame of the rig.
    axes
        (N, 2, 3) whitened tangents.
    variance
        (N,) mean variances of the bearings along tangents, square radians.
    """

    points: Any
    origins: Any
    bearings: Any
    axes: Any
    variance: Any

    @staticmethod
    def sizes(problem):
        return 3, 8, 2, 6

    @staticmethod
    def solve_minimal(problem, sample, models):
        origins = problem.origins[sample]
        if np.abs(origins - origins[0]).max() > 0.0:
            return gp3p(problem.points[sample], origins, problem.bearings[sample], models)
        count = p3p(problem.points[sample], problem.bearings[sample], models)
        for k in range(count):
            models[k, :, 3] += origins[0]
        return count

    @staticmethod
    def squared_error(problem, model, i, j):
        (x, y, z), _ = _direction(times(model, problem.points[i]), model[:, 3], problem.origins[j])
        b = problem.bearings[j]
        return ((x - b[0]) ** 2 + (y - b[1]) ** 2 + (z - b[2]) ** 2) / problem.variance[j]

    @staticmethod
    def linearize(problem, model, i, residual, jacobian):
        rotated, b, axes = times(model, problem.points[i]), problem.bearings[i], problem.axes[i]
        p, inverse = _direction(rotated, model[:, 3], problem.origins[i])
        if dot(p, b) <= 0.0:
            return False
        for k in range(2):
            residual[k] = dot(axes[k], (p[0] - b[0], p[1] - b[1], p[2] - b[2]))
            by_w, by_v = derivatives_along(axes[k], p, inverse, rotated)
            jacobian[k, 0], jacobian[k, 1], jacobian[k, 2] = by_w
            jacobian[k, 3], jacobian[k, 4], jacobian[k, 5] = by_v
        return True

    @staticmethod
    def feature(problem, model, i):
        _, inverse = _direction(times(model, problem.points[i]), model[:, 3], problem.origins[i])
        return 1.0 / inverse

    @staticmethod
    def retract(problem, model, step):
        rotate_and_translate(model, step)


@njit_helper
def _direction(rotated, translation, origin):
    """Return the direction of R X + t from an origin, given R X, and the inverse distance."""
    x = rotated[0] + translation[0] - origin[0]
    y = rotated[1] + translation[1] - origin[1]
    z = rotated[2] + translation[2] - origin[2]
    inverse = 1.0 / max(np.sqrt(x * x + y * y + z * z), 1e-300)
    return (x * inverse, y * inverse, z * inverse), inverse
