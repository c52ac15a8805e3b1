"""Compiled generalized P3P solver: poses of a rig, or of a non-central camera, from three rays to known points.

D. Nister and H. Stewenius, A minimal solution to the generalised 3-point pose problem, JMIV 27, 2007. The points
p_i + lambda_i f_i of the rays have the distances of the known points: three equations, quadratic in two lambdas each.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_helper
from omnisight.optim._polynomial_kernel import multiply_add, real_roots
from omnisight.twoview._p3p_kernel import align_triangle, newton_step, squared_lengths

# Steps that polish the distances of a solution.
NEWTON_STEPS = 8
# Largest residual of the squared distances, relative to the longest squared side, of a solution.
MAX_RESIDUAL = 1e-9


@njit_helper
def gp3p(points, origins, bearings, poses):
    """Compute the poses with positive distances along three rays to known points; return their number.

    Parameters
    ----------
    points
        (3, 3) world points.
    origins, bearings
        (3, 3) origins and directions of the rays in the frame of the rig.
    poses
        (8, 3, 4), receives [R | t]: the point X is on its ray at R X + t.
    """
    sides = squared_lengths(points)
    scale = np.sqrt(sides.max())
    if not scale > 0.0:
        return 0
    equations = _equations(origins / scale, bearings, sides / (scale * scale))
    polynomial, roots = _eliminate(equations), np.empty(8)
    distances, posed = np.empty(3), np.empty((3, 3))
    count = 0
    for n in range(real_roots(polynomial, roots)):
        distances[0] = roots[n]
        _other_distances(equations, distances)
        if _refine(equations, distances):
            for i in range(3):
                for j in range(3):
                    posed[i, j] = origins[i, j] + scale * distances[i] * bearings[i, j]
            count += align_triangle(points, posed, poses[count])
    return count


@njit_helper
def _equations(origins, bearings, sides):
    """Return the coefficients (3, 4) of l_i l_j, l_i, l_j and 1 in the equation l_i^2 + l_j^2 + ... = 0 of each side.

    Side k connects the points i = k + 1 and j = k + 2 modulo 3.
    """
    equations = np.zeros((3, 4))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        equations[k, 3] = -sides[k]
        for m in range(3):
            step = origins[i, m] - origins[j, m]
            equations[k, 0] -= 2.0 * bearings[i, m] * bearings[j, m]
            equations[k, 1] += 2.0 * step * bearings[i, m]
            equations[k, 2] -= 2.0 * step * bearings[j, m]
            equations[k, 3] += step * step
    return equations


@njit_helper
def _eliminate(equations):
    """Return the polynomial (9,) in the first distance.

    With x, y, z for the distances, side 1 is z^2 + p z + q = 0 with polynomials in x, side 0 with polynomials in y.
    Their resultant is reduced by side 2, y^2 + g y + h = 0, to r y + s with polynomials in x.
    """
    resultant = _resultant(equations)
    g, h = np.array([equations[2, 2], equations[2, 0]]), np.array([equations[2, 3], equations[2, 1], 1.0])
    for power in range(4, 1, -1):
        multiply_add(resultant[power - 1], resultant[power], g, -1.0)
        multiply_add(resultant[power - 2], resultant[power], h, -1.0)
    s, r = resultant[0], resultant[1]
    polynomial, product = np.zeros(9), np.zeros(9)
    multiply_add(polynomial, s, s, 1.0)
    multiply_add(polynomial, multiply_add(product, r, g, 1.0), s, -1.0)
    product[:] = 0.0
    multiply_add(polynomial, multiply_add(product, r, h, 1.0), r, 1.0)
    return polynomial


@njit_helper
def _resultant(equations):
    """Return the resultant (5, 5) by z of the sides 0 and 1, coefficients of y^i x^j."""
    # p, q of both sides and their differences as polynomials in (y, x).
    p0, q0, p1, q1 = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    p0[0, 0], p0[1, 0] = equations[0, 2], equations[0, 0]
    q0[0, 0], q0[1, 0], q0[2, 0] = equations[0, 3], equations[0, 1], 1.0
    p1[0, 0], p1[0, 1] = equations[1, 1], equations[1, 0]
    q1[0, 0], q1[0, 1], q1[0, 2] = equations[1, 3], equations[1, 2], 1.0
    resultant, product = np.zeros((5, 5)), np.zeros((5, 5))
    _multiply_add(resultant, q1 - q0, q1 - q0, 1.0)
    _multiply_add(product, p0, q1, 1.0)
    _multiply_add(product, p1, q0, -1.0)
    _multiply_add(resultant, product[:4, :4], p0 - p1, 1.0)
    return resultant


@njit_helper
def _multiply_add(target, left, right, factor):
    """Add the product of two polynomials in two unknowns times a factor."""
    for i in range(len(left)):
        for j in range(len(right)):
            if i + j < len(target):
                multiply_add(target[i + j], left[i], right[j], factor)


@njit_helper
def _other_distances(equations, distances):
    """Fill in the second and third distance: of the roots on sides 2 and 1 those that fulfil side 0 best."""
    x = distances[0]
    best = np.inf
    for n in range(4):
        y = _root(equations[2, 0] * x + equations[2, 2], (x + equations[2, 1]) * x + equations[2, 3], n % 2)
        z = _root(equations[1, 0] * x + equations[1, 1], (x + equations[1, 2]) * x + equations[1, 3], n // 2)
        e = equations[0]
        residual = abs(y * y + z * z + e[0] * y * z + e[1] * y + e[2] * z + e[3])
        if residual < best:
            best, distances[1], distances[2] = residual, y, z


@njit_helper
def _root(p, q, which):
    """Return a root of x^2 + p x + q, the real part if it is complex."""
    root = np.sqrt(max(0.25 * p * p - q, 0.0))
    return -0.5 * p + (root if which == 0 else -root)


@njit_helper
def _refine(equations, distances):
    """Refine distances by Newton's method; return whether they are a solution with positive distances."""
    f, left, right = np.empty(3), np.empty(3), np.empty(3)
    largest = np.inf
    for step in range(NEWTON_STEPS):
        largest = 0.0
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            x, y, e = distances[i], distances[j], equations[k]
            f[k] = x * x + y * y + e[0] * x * y + e[1] * x + e[2] * y + e[3]
            left[k], right[k] = 2.0 * x + e[0] * y + e[1], 2.0 * y + e[0] * x + e[2]
            largest = max(largest, abs(f[k]))
        if largest < 1e-15 or step == NEWTON_STEPS - 1 or not newton_step(left, right, f, distances):
            break
    return largest < MAX_RESIDUAL and distances.min() > 0.0
