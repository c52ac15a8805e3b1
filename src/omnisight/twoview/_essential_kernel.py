"""Compiled decomposition of essential matrices into relative poses, with the test of positive distances.

With |t| = 1, u = R^T t and E = [t]x R, the cofactor matrix of E is t u^T, and R = t u^T - [t]x E. The pairs determine E
and t up to their signs: the rotations are R_s = t u^T - s [t]x E with s = 1 and -1, the translations t and -t.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_helper
from omnisight.twoview._alignment_kernel import orthonormalize
from omnisight.twoview._small_vectors_kernel import cross, dot, times


@njit_helper
def poses_from_essential(e, a, b, poses):
    """Compute the pose of an essential matrix with positive distances for all pairs; return the number, 0 or 1.

    Parameters
    ----------
    e
        (3, 3) essential matrix, of any scale and sign.
    a, b
        (N, 3) unit bearings of both cameras.
    poses
        (S, 3, 4), receives [R | t] with x_b = R x_a + t and t of unit length.
    """
    t, u = _epipoles(e)
    side, direction = _signs(e, t, u, a[0], b[0])
    if side * direction == 0:
        return 0
    for n in range(1, len(a)):
        if _signs(e, t, u, a[n], b[n]) != (side, direction):
            return 0
    _fill_pose(e, t, u, side, direction, poses[0])
    orthonormalize(poses[0])
    return 1


@njit_helper
def decompose_essential(e, a, b, pose):
    """Compute the one of the four poses with the most positive distances; return for how many pairs.

    The rotation is orthonormal to the accuracy of the essential matrix.
    """
    t, u = _epipoles(e)
    counts, most = np.zeros((3, 3), np.int64), 0  # by signs: index -1 is the last one
    for n in range(len(a)):
        side, direction = _signs(e, t, u, a[n], b[n])
        counts[side, direction] += 1
    for side in (1, -1):
        for direction in (1, -1):
            if counts[side, direction] > most:
                most = counts[side, direction]
                _fill_pose(e, t, u, side, direction, pose)
    return most


@njit_helper
def _epipoles(e):
    """Return the directions t and u of the baseline in both cameras; NaN if there is none."""
    cofactors = cross(e[1], e[2]), cross(e[2], e[0]), cross(e[0], e[1])
    # The longest column of the cofactor matrix is the most accurate multiple of t.
    t = 0.0, 0.0, 0.0
    for j in range(3):
        column = cofactors[0][j], cofactors[1][j], cofactors[2][j]
        if dot(column, column) > dot(t, t):
            t = column
    t = _normalized(t)
    return t, _normalized(
        (
            t[0] * cofactors[0][0] + t[1] * cofactors[1][0] + t[2] * cofactors[2][0],
            t[0] * cofactors[0][1] + t[1] * cofactors[1][1] + t[2] * cofactors[2][1],
            t[0] * cofactors[0][2] + t[1] * cofactors[1][2] + t[2] * cofactors[2][2],
        )
    )


@njit_helper
def _normalized(v):
    inverse = 1.0 / np.sqrt(dot(v, v))
    return v[0] * inverse, v[1] * inverse, v[2] * inverse


@njit_helper
def _signs(e, t, u, a, b):
    """Return the signs of E and t for which a pair has positive distances; 0 if there is none.

    The component of R_s a across t is s E a x t: that of b is on the same side. The rays then meet at positive
    distances if b is nearer to the direction of the translation than R_s a, whose component along t is u.a.
    """
    return _sign(dot(b, cross(times(e, a), t))), _sign(dot(t, b) - dot(u, a))


@njit_helper
def _sign(x):
    return int(x > 0.0) - int(x < 0.0)


@njit_helper
def _fill_pose(e, t, u, side, direction, pose):
    """Fill in the pose [R_s | +-t] of an essential matrix of any scale."""
    s = side / np.sqrt(0.5 * (dot(e[0], e[0]) + dot(e[1], e[1]) + dot(e[2], e[2])))
    for j in range(3):
        x, y, z = cross(t, (e[0, j], e[1, j], e[2, j]))
        pose[0, j] = t[0] * u[j] - s * x
        pose[1, j] = t[1] * u[j] - s * y
        pose[2, j] = t[2] * u[j] - s * z
    pose[0, 3], pose[1, 3], pose[2, 3] = direction * t[0], direction * t[1], direction * t[2]
