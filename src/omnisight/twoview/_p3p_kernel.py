"""Compiled P3P solver: absolute poses from three bearings of known points.

The distances lambda along the bearings fulfil Q_ij(lambda) = lambda_i^2 + lambda_j^2 - 2 lambda_i lambda_j b_i.b_j =
d_ij^2. Without their common scale, these equations are two conics (M. Persson and K. Nordberg, Lambda Twist, ECCV 2018;
Y. Ding et al., Revisiting the P3P problem, CVPR 2023). Distances, unlike depths, exist for bearings of any direction.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_helper
from omnisight.twoview._alignment_kernel import fill_translation, rotation_between
from omnisight.twoview._conic_kernel import intersect_conics

# Steps that polish the distances of a solution.
NEWTON_STEPS = 5
# Largest residual of the squared distances, relative to the longest squared side, of a solution.
MAX_RESIDUAL = 1e-9


@njit_helper
def p3p(points, bearings, poses):
    """Compute the poses with positive distances along three bearings of known points; return their number.

    Parameters
    ----------
    points, bearings
        (3, 3) world points and bearings of the camera.
    poses
        (4, 3, 4), receives [R | t]: the point X has the bearing along R X + t.
    """
    chords, sides = squared_lengths(bearings), squared_lengths(points)
    longest = np.argmax(sides)
    scale = sides[longest]
    if not scale > 0.0:
        return 0
    sides /= scale
    first, second = _conics(chords, sides, longest)
    distances, posed = np.empty((4, 3)), np.empty((3, 3))
    count = 0
    for n in range(intersect_conics(first, second, distances)):
        if _refine(distances[n], chords, sides):
            for i in range(3):
                for j in range(3):
                    posed[i, j] = np.sqrt(scale) * distances[n, i] * bearings[i, j]
            count += align_triangle(points, posed, poses[count])
    return count


@njit_helper
def squared_lengths(corners):
    """Return the squared lengths (3,) of the sides of a triangle; side k is opposite to corner k."""
    squares = np.empty(3)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        squares[k] = 0.0
        for m in range(3):
            squares[k] += (corners[i, m] - corners[j, m]) ** 2
    return squares


@njit_helper
def _conics(chords, sides, longest):
    """Return the conics that eliminate the longest side from the equations of the other two."""
    conics = np.zeros((2, 3, 3))
    for n in range(2):
        other = (longest + 1 + n) % 3
        _add_conic(conics[n], other, chords[other], sides[longest])
        _add_conic(conics[n], longest, chords[longest], -sides[other])
    return conics[0], conics[1]


@njit_helper
def _add_conic(conic, side, chord, factor):
    """Add the conic Q of a side times a factor; b_i.b_j = 1 - chord/2."""
    i, j = (side + 1) % 3, (side + 2) % 3
    conic[i, i] += factor
    conic[j, j] += factor
    conic[i, j] -= factor * (1.0 - 0.5 * chord)
    conic[j, i] -= factor * (1.0 - 0.5 * chord)


@njit_helper
def _refine(distances, chords, sides):
    """Scale distances along the bearings and refine them by Newton's method; return whether they are a solution."""
    if distances[0] < 0.0:
        distances *= -1.0
    if not distances.min() > 0.0:
        return False
    total = 0.0
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        total += (distances[i] - distances[j]) ** 2 + distances[i] * distances[j] * chords[k]
    distances *= np.sqrt((sides[0] + sides[1] + sides[2]) / total)
    f, left, right = np.empty(3), np.empty(3), np.empty(3)
    for step in range(NEWTON_STEPS):
        largest = 0.0
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            difference = distances[i] - distances[j]
            f[k] = difference * difference + distances[i] * distances[j] * chords[k] - sides[k]
            left[k], right[k] = 2.0 * difference + distances[j] * chords[k], distances[i] * chords[k] - 2.0 * difference
            largest = max(largest, abs(f[k]))
        if largest < 1e-15 or step == NEWTON_STEPS - 1 or not newton_step(left, right, f, distances):
            break
    return largest < MAX_RESIDUAL and distances.min() > 0.0


@njit_helper
def newton_step(left, right, f, distances):
    """Subtract J^-1 f from three distances; return False if J is singular.

    Row k of the Jacobian J has left[k] in column k + 1 and right[k] in column k + 2, modulo 3.
    """
    determinant = left[0] * left[1] * left[2] + right[0] * right[1] * right[2]
    if determinant == 0.0:
        return False
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        cofactors = left[k] * left[i] * f[j] + right[k] * right[j] * f[i] - left[i] * right[j] * f[k]
        distances[k] -= cofactors / determinant
    return True


@njit_helper
def align_triangle(points, posed, pose):
    """Compute the pose that moves three points to given positions; return 0 if they are collinear."""
    u, v = points[1] - points[0], points[2] - points[0]
    if not rotation_between(u, v, posed[1] - posed[0], posed[2] - posed[0], pose):
        return 0
    fill_translation(points, posed, pose)
    return 1
