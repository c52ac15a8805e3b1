"""Compiled triangulation of points from any number of rays."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver, njit_helper
from omnisight.optim._cholesky_kernel import solve_symmetric
from omnisight.twoview._small_vectors_kernel import copy_elements, cross, dot, perpendiculars, quadratic_form, whitened

# Levenberg-Marquardt: steps, relative decrease of the cost at which they end, and damping.
MAX_ITERATIONS, TOLERANCE = 30, 1e-12
INITIAL_DAMPING, MAX_DAMPING = 1e-6, 1e8


@njit_driver
def midpoints(origins, directions):
    """Return the points (N, 3) with the least sum of squared distances from their rays; NaN for parallel rays.

    Parameters
    ----------
    origins, directions
        (N, V, 3); rays with NaN are left out.
    """
    points = np.full((len(origins), 3), np.nan)
    for n in range(len(origins)):
        matrix, right, rays = np.zeros((3, 3)), np.zeros(3), 0
        for v in range(origins.shape[1]):
            d, o = directions[n, v], origins[n, v]
            if np.isnan(d[0]) or np.isnan(o[0]):
                continue
            rays += 1
            along = dot(d, o)
            for i in range(3):
                right[i] += o[i] - along * d[i]
                for j in range(3):
                    matrix[i, j] += (1.0 if i == j else 0.0) - d[i] * d[j]
        if rays > 1:
            solution = solve_symmetric(matrix, right)
            if dot(solution, solution) > 0.0:
                for i in range(3):
                    points[n, i] = solution[i]
    return points


@njit_driver
def whitening_maps(covariance):
    """Return the maps (N, 2, 3) of vectors to two components of unit variance.

    Parameters
    ----------
    covariance
        (N, 3, 3), each zero along one direction: the largest vector product of two rows.
    """
    maps = np.empty((len(covariance), 2, 3))
    for n in range(len(covariance)):
        c, along, largest = covariance[n], (0.0, 0.0, 1.0), 0.0
        for i in range(3):
            normal = cross(c[i], c[(i + 1) % 3])
            square = dot(normal, normal)
            if square > largest:
                along, largest = normal, square
        inverse = 1.0 / np.sqrt(largest) if largest > 0.0 else 1.0
        first, second = perpendiculars((inverse * along[0], inverse * along[1], inverse * along[2]))
        variances = (
            quadratic_form(c, first, first),
            quadratic_form(c, first, second),
            quadratic_form(c, second, second),
        )
        one, two = whitened(first, second, *variances)
        for j in range(3):
            maps[n, 0, j], maps[n, 1, j] = one[j], two[j]
    return maps


@njit_driver
def angular_optimum(points, origins, directions, whitening):
    """Minimize the whitened chords between rays and directions of points, by Levenberg-Marquardt.

    Parameters
    ----------
    points
        (N, 3) initial points; NaN is kept.
    origins, directions
        (N, V, 3) of the rays.
    whitening
        (N, V, 2, 3) maps of chords to two components of unit variance.

    Returns
    -------
    points, cost, information
        (N, 3), sum of squared components (N,), and J^T J (N, 3, 3) at the points.
    """
    points, information, costs = points.copy(), np.zeros((len(points), 3, 3)), np.full(len(points), np.nan)
    for n in range(len(points)):
        if not np.isnan(points[n, 0]):
            costs[n] = refine_point(points[n], origins[n], directions[n], whitening[n], information[n])
    return points, costs, information


@njit_driver
def largest_angles(directions):
    """Return the largest angles (N,) between two of the directions (N, V, 3) of points; NaN entries are left out."""
    angles = np.empty(len(directions))
    for n in range(len(directions)):
        largest = 0.0
        for v in range(directions.shape[1]):
            a = directions[n, v]
            for w in range(v):
                b = directions[n, w]
                square = (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2
                if square > largest:  # not if it is NaN
                    largest = square
        angles[n] = 2.0 * np.arcsin(min(0.5 * np.sqrt(largest), 1.0))
    return angles


@njit_helper
def refine_point(point, origins, directions, whitening, information):
    """Minimize the whitened chords of one point (3,) in place; fill J^T J (3, 3), and return the cost."""
    gradient, trial, damped = np.empty(3), np.empty(3), np.empty((3, 3))
    damping = INITIAL_DAMPING
    cost = _normal_equations(point, origins, directions, whitening, information, gradient)
    for _ in range(MAX_ITERATIONS):
        copy_elements(damped, information)
        for i in range(3):
            damped[i, i] *= 1.0 + damping
        step = solve_symmetric(damped, gradient)
        for i in range(3):
            trial[i] = point[i] - step[i]
        new = _cost(trial, origins, directions, whitening)
        if new > cost or np.isnan(new):
            damping *= 10.0
            if damping > MAX_DAMPING:
                break
            continue
        has_converged = cost - new <= TOLERANCE * cost
        for i in range(3):
            point[i] = trial[i]
        damping *= 0.1
        cost = _normal_equations(point, origins, directions, whitening, information, gradient)
        if has_converged:
            break
    return cost


@njit_helper
def _cost(point, origins, directions, whitening):
    cost = 0.0
    for v in range(len(origins)):
        if np.isnan(directions[v, 0]) or np.isnan(origins[v, 0]):
            continue
        p, _ = _direction(point, origins[v])
        d = directions[v]
        chord = p[0] - d[0], p[1] - d[1], p[2] - d[2]
        cost += dot(whitening[v, 0], chord) ** 2 + dot(whitening[v, 1], chord) ** 2
    return cost


@njit_helper
def _normal_equations(point, origins, directions, whitening, hessian, gradient):
    """Fill J^T J (3, 3) and J^T r (3,); return the cost. A direction p at the distance s changes by (I - p p^T)/s."""
    hessian[:] = 0.0
    gradient[:] = 0.0
    cost, jacobian = 0.0, np.empty(3)
    for v in range(len(origins)):
        if np.isnan(directions[v, 0]) or np.isnan(origins[v, 0]):
            continue
        p, inverse = _direction(point, origins[v])
        d = directions[v]
        chord = p[0] - d[0], p[1] - d[1], p[2] - d[2]
        for k in range(2):
            row = whitening[v, k]
            along = dot(row, p)
            residual = dot(row, chord)
            cost += residual**2
            for i in range(3):
                jacobian[i] = (row[i] - along * p[i]) * inverse
            for i in range(3):
                gradient[i] += jacobian[i] * residual
                for j in range(3):
                    hessian[i, j] += jacobian[i] * jacobian[j]
    return cost


@njit_helper
def _direction(point, origin):
    x, y, z = point[0] - origin[0], point[1] - origin[1], point[2] - origin[2]
    inverse = 1.0 / max(np.sqrt(x * x + y * y + z * z), 1e-300)
    return (x * inverse, y * inverse, z * inverse), inverse
