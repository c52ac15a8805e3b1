"""Compiled decomposition of essential matrices into relative poses, with the test of positive distances."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_helper
from omnisight.twoview._alignment_kernel import orthonormalize
from omnisight.twoview._small_vectors_kernel import copy_elements, cross, dot, times


@njit_helper
def poses_from_essential(e, a, b, poses):
    """Compute the pose of an essential matrix with positive distances for all pairs; return the number, 0 or 1.

    Parameters
    ----------
    e
        (3, 3) essential matrix, of any scale and sign.
    a, b
        (N, 3) bearings of both cameras.
    poses
        (S, 3, 4), receives [R | t] with x_b = R x_a + t and t of unit length.
    """
    # The first pair has positive distances for one of the four decompositions.
    pose = poses[0]
    if decompose_essential(e, a[:1], b[:1], pose) == 0:
        return 0
    for n in range(1, len(a)):
        along_a, along_b = distance_signs(pose, pose[:, 3], a[n], b[n])
        if not (along_a > 0.0 and along_b > 0.0):
            return 0
    orthonormalize(pose)
    return 1


@njit_helper
def decompose_essential(e, a, b, pose):
    """Compute the one of the four decompositions with the most positive distances; return for how many pairs.

    The rotation is orthonormal to the accuracy of the essential matrix. B. K. P. Horn, Recovering baseline and
    orientation from essential matrix, 1990: (cof E - [t]x E) = |t|^2 R.
    """
    cofactors = cross(e[1], e[2]), cross(e[2], e[0]), cross(e[0], e[1])
    square = 0.5 * (dot(e[0], e[0]) + dot(e[1], e[1]) + dot(e[2], e[2]))
    # The cofactor matrix is t t^T R: its longest column is the most accurate multiple of t.
    t, length = (0.0, 0.0, 0.0), 0.0
    for j in range(3):
        column = cofactors[0][j], cofactors[1][j], cofactors[2][j]
        if dot(column, column) > length:
            t, length = column, dot(column, column)
    if not length > 0.0:
        return 0
    inverse = 1.0 / np.sqrt(length)
    t = t[0] * inverse, t[1] * inverse, t[2] * inverse
    rotation, most = np.empty((3, 3)), -1
    for scale in (1.0 / np.sqrt(square), -1.0 / np.sqrt(square)):
        for j in range(3):
            x, y, z = cross(t, (e[0, j], e[1, j], e[2, j]))
            rotation[0, j] = cofactors[0][j] / square - scale * x
            rotation[1, j] = cofactors[1][j] / square - scale * y
            rotation[2, j] = cofactors[2][j] / square - scale * z
        positive, negative = count_distance_signs(rotation, t, a, b)
        if max(positive, negative) > most:
            most = max(positive, negative)
            sign = 1.0 if positive >= negative else -1.0
            copy_elements(pose, rotation)
            pose[0, 3], pose[1, 3], pose[2, 3] = sign * t[0], sign * t[1], sign * t[2]
    return most


@njit_helper
def count_distance_signs(rotation, t, a, b):
    """Return the number of pairs whose distances along both bearings are positive, and that for the translation -t."""
    positive, negative = 0, 0
    for n in range(len(a)):
        sign_a, sign_b = distance_signs(rotation, t, a[n], b[n])
        if sign_a > 0.0 and sign_b > 0.0:
            positive += 1
        elif sign_a < 0.0 and sign_b < 0.0:
            negative += 1
    return positive, negative


@njit_helper
def distance_signs(rotation, t, a, b):
    """Return the distances along two bearings times |R a x b|^2, which have the signs of the distances.

    With p = R a and q = b, lambda_a p + t = lambda_b q: lambda_a = -(t x q).(p x q)/|p x q|^2 and
    lambda_b = -(t x p).(p x q)/|p x q|^2.
    """
    p = times(rotation, a)
    m = cross(p, b)
    # (t x q).m = t.(q x m)
    return -dot(t, cross(b, m)), -dot(t, cross(p, m))
