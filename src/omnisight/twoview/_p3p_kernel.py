"""Compiled P3P solver: absolute poses from three bearings of known points.

The distances lambda along the bearings fulfil Q_ij(lambda) = lambda_i^2 + lambda_j^2 - 2 lambda_i lambda_j b_i.b_j =
d_ij^2. The equations without their common scale are two conics D_1 and D_2. A real root of det(D_1 + x D_2) = 0 gives a
pair of lines through their intersections (M. Persson and K. Nordberg, Lambda Twist, ECCV 2018; Y. Ding et al.,
Revisiting the P3P problem, CVPR 2023). Distances, unlike depths, exist for bearings of any direction.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_helper

NEWTON_STEPS = 5
# Largest residual of the squared distances, relative to the longest squared side, of a solution.
MAX_RESIDUAL = 1e-9
# Discriminant, relative to its terms, of a double root that rounding moved off the real axis.
ROUNDING = 1e-10


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
    x = pencil_root(first, second)
    lines = np.empty((2, 3))
    if not split_conic(first + x * second, lines):
        return 0
    conic = second if x * x < 1.0 else first  # the larger: they are proportional on the lines
    distances = np.empty((2, 3))
    count = 0
    for k in range(2):
        for n in range(intersect(lines[k], conic, distances)):
            if _refine(distances[n], chords, sides):
                distances[n] *= np.sqrt(scale)
                count += align_triangle(points, bearings, distances[n], poses[count])
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
def intersect(line, conic, distances):
    """Compute the points (2, 3) of a line and a conic with coordinates of one sign, made positive."""
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
    count = 0
    for n in range(2):
        s, w = (-h, uu) if n == 0 else (vv, -h)
        last = p * s + q * w
        if s < 0.0 and w < 0.0 and last < 0.0:
            s, w, last = -s, -w, -last
        if s > 0.0 and w > 0.0 and last > 0.0:
            distances[count, i], distances[count, j], distances[count, k] = s, w, last
            count += 1
    return count


@njit_helper
def _refine(distances, chords, sides):
    """Scale distances along the bearings and refine them by Newton's method; return whether they are a solution."""
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
        if largest < 1e-15 or step == NEWTON_STEPS - 1:
            break
        # Row k of the Jacobian has left[k] in column k + 1 and right[k] in column k + 2.
        determinant = left[0] * left[1] * left[2] + right[0] * right[1] * right[2]
        if determinant == 0.0:
            break
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            cofactors = left[k] * left[i] * f[j] + right[k] * right[j] * f[i] - left[i] * right[j] * f[k]
            distances[k] -= cofactors / determinant
    return largest < MAX_RESIDUAL and distances.min() > 0.0


@njit_helper
def align_triangle(points, bearings, distances, pose):
    """Compute the pose that moves three points to distances along the bearings; return 0 if they are collinear."""
    posed = np.empty((3, 3))
    for n in range(3):
        for m in range(3):
            posed[n, m] = distances[n] * bearings[n, m]
    source, target = np.empty((3, 3)), np.empty((3, 3))
    if not (triangle_axes(points, source) and triangle_axes(posed, target)):
        return 0
    for i in range(3):
        for j in range(3):
            pose[i, j] = target[0, i] * source[0, j] + target[1, i] * source[1, j] + target[2, i] * source[2, j]
    for i in range(3):
        pose[i, 3] = 0.0
        for n in range(3):
            rotated = pose[i, 0] * points[n, 0] + pose[i, 1] * points[n, 1] + pose[i, 2] * points[n, 2]
            pose[i, 3] += (posed[n, i] - rotated) / 3.0
    return 1


@njit_helper
def triangle_axes(corners, axes):
    """Compute orthonormal axes (3, 3), in rows, of a triangle; return False if its corners are collinear."""
    ux, uy, uz = corners[1, 0] - corners[0, 0], corners[1, 1] - corners[0, 1], corners[1, 2] - corners[0, 2]
    vx, vy, vz = corners[2, 0] - corners[0, 0], corners[2, 1] - corners[0, 1], corners[2, 2] - corners[0, 2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    u, v, n = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, np.sqrt(nx * nx + ny * ny + nz * nz)
    if not n > 1e-12 * max(u, v):
        return False
    u = np.sqrt(u)
    axes[0, 0], axes[0, 1], axes[0, 2] = ux / u, uy / u, uz / u
    axes[1, 0], axes[1, 1], axes[1, 2] = nx / n, ny / n, nz / n
    for k in range(3):
        after, last = (k + 1) % 3, (k + 2) % 3
        axes[2, k] = axes[0, after] * axes[1, last] - axes[0, last] * axes[1, after]
    return True
