"""Compiled decomposition of essential matrices into relative poses, with the test of positive distances."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_helper
from omnisight.twoview._alignment_kernel import orthonormalize


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
        along_a, along_b = distance_signs(pose[:, :3], pose[:, 3], a[n], b[n])
        if not (along_a > 0.0 and along_b > 0.0):
            return 0
    return 1


@njit_helper
def decompose_essential(e, a, b, pose):
    """Compute the one of the four decompositions with the most positive distances; return for how many pairs.

    B. K. P. Horn, Recovering baseline and orientation from essential matrix, 1990: (cof E - [t]x E) = |t|^2 R.
    """
    cofactors = np.empty((3, 3))
    square = 0.0
    for i in range(3):
        for j in range(3):
            m, n, p, q = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            cofactors[i, j] = e[m, p] * e[n, q] - e[m, q] * e[n, p]
            square += 0.5 * e[i, j] ** 2
    # The cofactor matrix is t t^T R: its longest column is the most accurate multiple of t.
    best, length = 0, 0.0
    for j in range(3):
        squared = cofactors[0, j] ** 2 + cofactors[1, j] ** 2 + cofactors[2, j] ** 2
        if squared > length:
            best, length = j, squared
    if not length > 0.0:
        return 0
    t = cofactors[:, best] / np.sqrt(length)
    rotations = np.empty((2, 3, 3))
    chosen, sign, most = 0, 1.0, -1
    for k in range(2):
        scale = (1.0 - 2.0 * k) / np.sqrt(square)
        for i in range(3):
            after, last = (i + 1) % 3, (i + 2) % 3
            for j in range(3):
                rotations[k, i, j] = cofactors[i, j] / square - scale * (t[after] * e[last, j] - t[last] * e[after, j])
        positive, negative = count_distance_signs(rotations[k], t, a, b)
        if positive > most:
            chosen, sign, most = k, 1.0, positive
        if negative > most:
            chosen, sign, most = k, -1.0, negative
    for i in range(3):
        for j in range(3):
            pose[i, j] = rotations[chosen, i, j]
        pose[i, 3] = sign * t[i]
    orthonormalize(pose)
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
    px = rotation[0, 0] * a[0] + rotation[0, 1] * a[1] + rotation[0, 2] * a[2]
    py = rotation[1, 0] * a[0] + rotation[1, 1] * a[1] + rotation[1, 2] * a[2]
    pz = rotation[2, 0] * a[0] + rotation[2, 1] * a[1] + rotation[2, 2] * a[2]
    mx, my, mz = py * b[2] - pz * b[1], pz * b[0] - px * b[2], px * b[1] - py * b[0]
    # (t x q).m = t.(q x m)
    along_a = t[0] * (b[1] * mz - b[2] * my) + t[1] * (b[2] * mx - b[0] * mz) + t[2] * (b[0] * my - b[1] * mx)
    along_b = t[0] * (py * mz - pz * my) + t[1] * (pz * mx - px * mz) + t[2] * (px * my - py * mx)
    return -along_a, -along_b
