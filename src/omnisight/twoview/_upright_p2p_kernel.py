"""Compiled P2P solver: absolute poses from two bearings of known points and the vertical, the y axis of both frames.

Z. Kukelova, M. Bujnak and T. Pajdla, Closed-form solutions to minimal absolute pose problems with known vertical
direction, ACCV 2010, here with distances instead of depths. With D = R (X_1 - X_2) = lambda_1 b_1 - lambda_2 b_2, the
height of D is known, which is linear in the distances, and its horizontal length, which is quadratic.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_helper
from omnisight.twoview._alignment_kernel import fill_translation
from omnisight.twoview._upright_kernel import turn

# Discriminant, relative to its terms, of a double root that rounding moved off the real axis.
ROUNDING = 1e-12


@njit_helper
def upright_p2p(points, bearings, poses):
    """Compute the poses (2, 3, 4), R about y, with positive distances along two bearings; return their number."""
    dx, dy, dz = points[0, 0] - points[1, 0], points[0, 1] - points[1, 1], points[0, 2] - points[1, 2]
    horizontal = dx * dx + dz * dz
    rise, fall = bearings[0, 1], -bearings[1, 1]
    square = rise * rise + fall * fall
    if not (square > 0.0 and horizontal > 0.0):
        return 0
    # The distances (lambda_1, lambda_2) with the height dy are dy (rise, fall)/square + tau (-fall, rise).
    at, along = dy / square, 1.0 / np.sqrt(square)
    base_x, base_z = _horizontal(bearings, at * rise, at * fall)
    step_x, step_z = _horizontal(bearings, -along * fall, along * rise)
    uu, uv = step_x * step_x + step_z * step_z, step_x * base_x + step_z * base_z
    vv = base_x * base_x + base_z * base_z - horizontal
    discriminant = uv * uv - uu * vv
    if not (uu > 0.0 and discriminant >= -ROUNDING * (uv * uv + abs(uu * vv))):
        return 0
    root = np.sqrt(max(discriminant, 0.0))
    far = -uv - root if uv >= 0.0 else -uv + root
    posed = np.empty((2, 3))
    count = 0
    for n in range(2):
        tau = far / uu if n == 0 else vv / far
        first, second = at * rise - tau * along * fall, at * fall + tau * along * rise
        if first > 0.0 and second > 0.0 and np.isfinite(tau):
            x, z = _horizontal(bearings, first, second)
            turn(poses[count], (x * dx + z * dz) / horizontal, (x * dz - z * dx) / horizontal)
            posed[0], posed[1] = first * bearings[0], second * bearings[1]
            fill_translation(points, posed, poses[count])
            count += 1
    return count


@njit_helper
def _horizontal(bearings, first, second):
    """Return x and z of the difference of two bearings times their distances."""
    return first * bearings[0, 0] - second * bearings[1, 0], first * bearings[0, 2] - second * bearings[1, 2]
