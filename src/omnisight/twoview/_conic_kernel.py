"""Compiled intersection of two conics, by the lines through their intersections.

A real root of det(first + x second) = 0 gives a degenerate conic of the pencil: two lines, each of which intersects the
conics in two points. Points and lines are homogeneous, so no point is singular.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_helper

# Discriminant, relative to its terms, of a double root that rounding moved off the real axis.
ROUNDING = 1e-10


@njit_helper
def intersect_conics(first, second, points):
    """Compute the real points (4, 3) on two conics, symmetric matrices (3, 3) of similar size; return their number."""
    x = pencil_root(first, second)
    lines = np.empty((2, 3))
    if not split_conic(first + x * second, lines):
        return 0
    conic = second if x * x < 1.0 else first  # the larger: on the lines they are proportional
    count = 0
    for k in range(2):
        count += intersect_line(lines[k], conic, points[count:])
    return count


@njit_helper
def pencil_root(first, second):
    """Return the most isolated real x with det(first + x second) = 0."""
    a, b = adjugate(first), adjugate(second)
    c0 = c1 = c2 = c3 = 0.0
    for i in range(3):
        c0 += a[0, i] * first[i, 0]
        c3 += b[0, i] * second[i, 0]
        for j in range(3):
            c1 += a[i, j] * second[j, i]
            c2 += b[i, j] * first[j, i]
    if abs(c3) >= abs(c0):
        return cubic_root(c0, c1, c2, c3)
    return 1.0 / cubic_root(c3, c2, c1, c0)


@njit_helper
def adjugate(m):
    """Return the adjugate of a symmetric matrix (3, 3)."""
    result = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            p, q, r, s = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            result[i, j] = m[p, r] * m[q, s] - m[p, s] * m[q, r]
    return result


@njit_helper
def cubic_root(c0, c1, c2, c3):
    """Return the real root of c0 + c1 x + c2 x^2 + c3 x^3 that is farthest from the others."""
    a, b, c = c2 / c3, c1 / c3, c0 / c3
    p, q = b - a * a / 3.0, a * (2.0 * a * a / 27.0 - b / 3.0) + c
    discriminant = 0.25 * q * q + p * p * p / 27.0
    if discriminant >= 0.0:
        u = np.cbrt(0.5 * abs(q) + np.sqrt(discriminant))
        t = u - p / (3.0 * u) if u > 0.0 else 0.0
    else:
        r = np.sqrt(-p / 3.0)
        t = 2.0 * r * np.cos(np.arccos(min(0.5 * abs(q) / (r * r * r), 1.0)) / 3.0)
    x = (-t if q > 0.0 else t) - a / 3.0
    for _ in range(2):
        slope = (3.0 * x + 2.0 * a) * x + b
        if slope != 0.0:
            x -= (((x + a) * x + b) * x + c) / slope
    return x


@njit_helper
def split_conic(conic, lines):
    """Split a degenerate conic (3, 3) into two real lines (2, 3); return False if they are complex.

    J. Richter-Gebert, Perspectives on Projective Geometry, 11.1: the conic plus the cross-product matrix of the
    intersection of the lines has rank one.
    """
    adjoint = adjugate(conic)
    i = 0
    for k in range(1, 3):
        if abs(adjoint[k, k]) > abs(adjoint[i, i]):
            i = k
    square = 0.0
    for k in range(9):
        square += conic[k // 3, k % 3] ** 2
    if not adjoint[i, i] <= ROUNDING * square:
        return False
    scale = 1.0 / np.sqrt(-adjoint[i, i]) if adjoint[i, i] < 0.0 else 0.0
    m = conic.copy()
    for k in range(3):
        after, last = (k + 1) % 3, (k + 2) % 3
        m[after, last] += scale * adjoint[k, i]
        m[last, after] -= scale * adjoint[k, i]
    row, column = 0, 0
    for k in range(9):
        if abs(m[k // 3, k % 3]) > abs(m[row, column]):
            row, column = k // 3, k % 3
    for k in range(3):
        lines[0, k], lines[1, k] = m[row, k], m[k, column]
    return True


@njit_helper
def intersect_line(line, conic, points):
    """Compute the points (2, 3) of a line on a conic; return their number."""
    k = 0
    for i in range(1, 3):
        if abs(line[i]) > abs(line[k]):
            k = i
    i, j = (k + 1) % 3, (k + 2) % 3
    # Points s u + w v of the line, where u and v have the coordinates (i, j, k) = (1, 0, p) and (0, 1, q).
    p, q = -line[i] / line[k], -line[j] / line[k]
    uu = conic[i, i] + 2.0 * p * conic[i, k] + p * p * conic[k, k]
    uv = conic[i, j] + q * conic[i, k] + p * conic[j, k] + p * q * conic[k, k]
    vv = conic[j, j] + 2.0 * q * conic[j, k] + q * q * conic[k, k]
    discriminant = uv * uv - uu * vv
    if not discriminant >= -ROUNDING * (uv * uv + abs(uu * vv)):
        return 0
    root = np.sqrt(max(discriminant, 0.0))
    h = uv + root if uv >= 0.0 else uv - root
    for n in range(2):
        s, w = (-h, uu) if n == 0 else (vv, -h)
        points[n, i], points[n, j], points[n, k] = s, w, p * s + q * w
    return 2
