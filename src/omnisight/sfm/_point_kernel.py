"""Compiled refinement of points with known poses, one by one.

For the residuals see `_bundle_kernel`.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver, njit_helper
from omnisight.twoview._small_vectors_kernel import dot, times, transposed_times

# Most iterations of a point, expected decrease of its cost at the end, and initial damping.
MAX_ITERATIONS, TOLERANCE, INITIAL_DAMPING = 20, 1e-6, 1e-3


@njit_helper
def point_direction(frame_pose, sensor_pose, point, origin):
    """Return R_f X, R_s x_rig, the direction of the point from the origin of the ray, and the inverse distance."""
    a = times(frame_pose, point)
    q = a[0] + frame_pose[0, 3], a[1] + frame_pose[1, 3], a[2] + frame_pose[2, 3]
    b = times(sensor_pose, q)
    x = b[0] + sensor_pose[0, 3] - origin[0]
    y = b[1] + sensor_pose[1, 3] - origin[1]
    z = b[2] + sensor_pose[2, 3] - origin[2]
    inverse = 1.0 / max(np.sqrt(x * x + y * y + z * z), 1e-300)
    return a, b, (x * inverse, y * inverse, z * inverse), inverse


@njit_helper
def information_of_point(by_point, residuals, first, last, gradient):
    """Return the information of a point, the six elements of its upper triangle; fill its gradient (3,)."""
    a, b, c, d, e, f = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    gradient[:] = 0.0
    for i in range(first, last):
        for k in range(2):
            x, y, z = by_point[i, k, 0], by_point[i, k, 1], by_point[i, k, 2]
            a, b, c, d, e, f = a + x * x, b + x * y, c + x * z, d + y * y, e + y * z, f + z * z
            gradient[0] += x * residuals[i, k]
            gradient[1] += y * residuals[i, k]
            gradient[2] += z * residuals[i, k]
    return a, b, c, d, e, f


@njit_helper
def damped_inverse(information, damping, inverse):
    """Fill the inverse (3, 3) of the damped information of a point."""
    a, b, c, d, e, f = information
    if not a + d + f > 0.0:  # all its rays are outliers: it keeps its place
        inverse[:] = 0.0
        return
    least = 1e-12 * (a + d + f)
    a, d, f = a * (1.0 + damping) + least, d * (1.0 + damping) + least, f * (1.0 + damping) + least
    p, q, r = d * f - e * e, c * e - b * f, b * e - c * d
    factor = 1.0 / (a * p + b * q + c * r)
    inverse[0, 0], inverse[0, 1], inverse[0, 2] = factor * p, factor * q, factor * r
    inverse[1, 1], inverse[1, 2] = factor * (a * f - c * c), factor * (b * c - a * e)
    inverse[2, 2] = factor * (a * d - b * b)
    inverse[1, 0], inverse[2, 0], inverse[2, 1] = inverse[0, 1], inverse[0, 2], inverse[1, 2]


@njit_helper
def _weighted(frame_pose, sensor_pose, point, origin, bearing, axes, degrees, variance, residual, by_point):
    """Fill a weighted residual (2,) and its derivatives by the point (2, 3); return its loss, without a limit."""
    _, _, u, inverse = point_direction(frame_pose, sensor_pose, point, origin)
    along = dot(axes[0], u), dot(axes[1], u)
    if dot(u, bearing) > 0.0:
        square = (along[0] ** 2 + along[1] ** 2) / variance
        root = np.sqrt((degrees + 2.0) / ((degrees + square) * variance))
    else:  # at least the loss of any point in front
        square, root = (dot(axes[0], axes[0]) + dot(axes[1], axes[1])) / variance, 0.0
    for k in range(2):
        row, scale = axes[k], root * inverse
        d = scale * (row[0] - along[k] * u[0]), scale * (row[1] - along[k] * u[1]), scale * (row[2] - along[k] * u[2])
        in_world = transposed_times(frame_pose, transposed_times(sensor_pose, d))
        residual[k] = root * along[k]
        for c in range(3):
            by_point[k, c] = in_world[c]
    return 0.5 * (degrees + 2.0) * np.log1p(square / degrees)


@njit_driver
def refine_points(
    frame_poses,
    sensor_poses,
    starts,
    frame,
    sensor,
    origins,
    bearings,
    axes,
    degrees,
    variance,
    first,
    last,
    residuals,
    by_point,
    points,
):
    """Minimize the robust cost of each of the points first ... last (P, 3) in place; the poses stay.

    `residuals` (N, 2) and `by_point` (N, 2, 3) are memory for the N observations of any point.
    """
    inverse, gradient, trial = np.empty((3, 3)), np.empty(3), np.empty(3)
    for n in range(first, last):
        start, count = starts[n], starts[n + 1] - starts[n]
        damping, cost, information = INITIAL_DAMPING, np.inf, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        for c in range(3):
            trial[c] = points[n, c]
        for _ in range(MAX_ITERATIONS):
            new = 0.0
            for k in range(count):
                i = start + k
                poses, ray = (frame_poses[frame[i]], sensor_poses[sensor[i]]), (origins[i], bearings[i], axes[i])
                new += _weighted(*poses, trial, *ray, degrees, variance, residuals[k], by_point[k])
            if new < cost:
                information = information_of_point(by_point, residuals, 0, count, gradient)
                cost, damping = new, 0.1 * damping
                for c in range(3):
                    points[n, c] = trial[c]
            else:
                damping *= 100.0
            damped_inverse(information, damping, inverse)
            expected = 0.0
            for c in range(3):
                step = dot(inverse[c], gradient)
                trial[c] = points[n, c] - step
                expected += 0.5 * step * gradient[c]
            if not expected > TOLERANCE * cost:
                break
