"""Compiled solvers for rotations about a known vertical, the y axis.

The epipolar constraint is t.m = 0 with m = R a x b and R = [[c, 0, s], [0, 1, 0], [-s, 0, c]]. The horizontal part
u = m_z + i m_x is alpha z + beta with z = c + i s, alpha = b_y (a_x - i a_z) and beta = a_y (-b_x + i b_z). The
vertical part is m_y = c (a_z b_x - a_x b_z) - s (a_x b_x + a_z b_z).
"""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_helper
from omnisight.twoview._conic_kernel import intersect_conics
from omnisight.twoview._small_vectors_kernel import cross, dot, times

# Discriminant, relative to its terms, of a double root that rounding moved off the real axis.
ROUNDING = 1e-12


@njit_helper
def upright_three_point(a, b, poses):
    """Compute the poses (4, 3, 4) of three pairs of bearings, R about y, with positive distances; return their number.

    det [m_1 m_2 m_3] is proportional to the sum of m_y,i Im(u_j conj u_k) over the cyclic permutations, a conic of the
    point (1, c, s), which lies on the unit circle too.
    """
    conic, circle = np.zeros((3, 3)), np.diag(np.array([-1.0, 1.0, 1.0]))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        constant, of_c, of_s = _coplanarity(a[j], b[j], a[k], b[k])
        along, across = a[i, 2] * b[i, 0] - a[i, 0] * b[i, 2], -a[i, 0] * b[i, 0] - a[i, 2] * b[i, 2]
        conic[0, 1] += 0.5 * constant * along
        conic[0, 2] += 0.5 * constant * across
        conic[1, 1] += of_c * along
        conic[1, 2] += 0.5 * (of_s * along + of_c * across)
        conic[2, 2] += of_s * across
    for i in range(3):
        for j in range(i):
            conic[i, j] = conic[j, i]
    turns, normals = np.empty((4, 3)), np.empty((3, 3))
    rotation, t = np.empty((3, 3)), np.empty(3)
    count = 0
    for n in range(intersect_conics(conic / np.abs(conic).max(), circle, turns)):
        turn(rotation, turns[n, 1] / turns[n, 0], turns[n, 2] / turns[n, 0])
        for i in range(3):
            _epipolar_normal(rotation, a[i], b[i], normals[i])
        _common_normal(normals, t)
        count += _pose(rotation, t, a, b, poses[count])
    return count


@njit_helper
def planar_two_point(a, b, poses):
    """Compute the poses (2, 3, 4) of two pairs, R about y, t normal to y, with positive distances; return the number.

    Both m are normal to t if Im(u_1 conj u_2) = 0.
    """
    constant, of_c, of_s = _coplanarity(a[0], b[0], a[1], b[1])
    square = of_c * of_c + of_s * of_s
    remainder = square - constant * constant
    if not (square > 0.0 and remainder >= -ROUNDING * square):
        return 0
    root = np.sqrt(max(remainder, 0.0))
    normals = np.empty((2, 3))
    rotation, t = np.empty((3, 3)), np.zeros(3)
    count = 0
    for n in range(2):
        signed = root if n == 0 else -root
        c, s = (-constant * of_c - signed * of_s) / square, (-constant * of_s + signed * of_c) / square
        turn(rotation, c, s)
        for i in range(2):
            _epipolar_normal(rotation, a[i], b[i], normals[i])
        longer = 0 if normals[0, 0] ** 2 + normals[0, 2] ** 2 > normals[1, 0] ** 2 + normals[1, 2] ** 2 else 1
        t[0], t[2] = normals[longer, 2], -normals[longer, 0]
        count += _pose(rotation, t, a, b, poses[count])
    return count


@njit_helper
def circular_one_point(a, b, poses):
    """Compute the pose (1, 3, 4) of one pair on an arc of a circle about y with z as tangent; return the number.

    With the half angle h of the turn, R is the rotation by -2 h and t is along (sin h, 0, -cos h). Therefore
    Re(u exp(i h)) = 0 is linear in cos h and sin h.
    """
    cosine = a[0, 1] * b[0, 2] + b[0, 1] * a[0, 2]
    sine = b[0, 1] * a[0, 0] - a[0, 1] * b[0, 0]
    length = np.sqrt(cosine * cosine + sine * sine)
    if not length > 0.0:
        return 0
    cosine, sine = cosine / length, sine / length
    rotation = np.empty((3, 3))
    turn(rotation, (cosine - sine) * (cosine + sine), -2.0 * cosine * sine)
    return _pose(rotation, np.array([sine, 0.0, -cosine]), a, b, poses[0])


@njit_helper
def _coplanarity(a, b, a_other, b_other):
    """Return the coefficients of 1, c and s in Im(u conj u') of two pairs."""
    alpha, beta = b[1] * complex(a[0], -a[2]), a[1] * complex(-b[0], b[2])
    alpha_other = b_other[1] * complex(a_other[0], a_other[2])  # both conjugate
    beta_other = a_other[1] * complex(-b_other[0], -b_other[2])
    constant = (alpha * alpha_other + beta * beta_other).imag
    slope = alpha * beta_other - beta.conjugate() * alpha_other.conjugate()
    return constant, slope.imag, slope.real


@njit_helper
def turn(pose, c, s):
    """Fill in the first three columns of a pose: the rotation about y with a cosine and a sine."""
    length = np.sqrt(c * c + s * s)
    pose[:, :3] = 0.0
    pose[0, 0], pose[0, 2], pose[2, 0], pose[2, 2] = c / length, s / length, -s / length, c / length
    pose[1, 1] = 1.0


@njit_helper
def _epipolar_normal(rotation, a, b, normal):
    """Compute m = R a x b for a rotation about y."""
    x, y, z = rotation[0, 0] * a[0] + rotation[0, 2] * a[2], a[1], rotation[2, 0] * a[0] + rotation[2, 2] * a[2]
    normal[0], normal[1], normal[2] = y * b[2] - z * b[1], z * b[0] - x * b[2], x * b[1] - y * b[0]


@njit_helper
def _common_normal(vectors, normal):
    """Compute the longest cross product of two of three vectors."""
    longest = -1.0
    for k in range(3):
        u, v = vectors[(k + 1) % 3], vectors[(k + 2) % 3]
        x, y, z = u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]
        square = x * x + y * y + z * z
        if square > longest:
            longest = square
            normal[0], normal[1], normal[2] = x, y, z


@njit_helper
def _pose(rotation, t, a, b, pose):
    """Write the pose with the translation t or -t with positive distances for all pairs; return 0 if neither has."""
    positive, negative = _count_distance_signs(rotation, t, a, b)
    length = np.sqrt(t[0] ** 2 + t[1] ** 2 + t[2] ** 2)
    if max(positive, negative) < len(a) or not length > 0.0:
        return 0
    sign = 1.0 if positive == len(a) else -1.0
    for i in range(3):
        for j in range(3):
            pose[i, j] = rotation[i, j]
        pose[i, 3] = sign * t[i] / length
    return 1


@njit_helper
def _count_distance_signs(rotation, t, a, b):
    """Return the number of pairs whose distances along both bearings are positive, and that for the translation -t.

    With p = R a and q = b, lambda_a p + t = lambda_b q: lambda_a = -(t x q).(p x q)/|p x q|^2 and
    lambda_b = -(t x p).(p x q)/|p x q|^2.
    """
    positive, negative = 0, 0
    for n in range(len(a)):
        p = times(rotation, a[n])
        m = cross(p, b[n])
        along_a, along_b = -dot(t, cross(b[n], m)), -dot(t, cross(p, m))  # (t x q).m = t.(q x m)
        if along_a > 0.0 and along_b > 0.0:
            positive += 1
        elif along_a < 0.0 and along_b < 0.0:
            negative += 1
    return positive, negative
