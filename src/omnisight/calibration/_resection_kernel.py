"""Compiled loops of the resection over board points."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver
from omnisight.twoview._absolute_pose_kernel import derivatives_along, direction
from omnisight.twoview._small_vectors_kernel import times

AXES = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@njit_driver
def squared_chords(points, view, rotations, translations, bearings):
    """Return the squared chords (N,) between bearings and the directions of points posed by their view."""
    squares = np.empty(len(points))
    for n in range(len(points)):
        k, b = view[n], bearings[n]
        p, _ = direction(times(rotations[k], points[n]), translations[k])
        squares[n] = (p[0] - b[0]) ** 2 + (p[1] - b[1]) ** 2 + (p[2] - b[2]) ** 2
    return squares


@njit_driver
def chord_normal_equations(points, view, rotations, translations, bearings, weights):
    """Return the normal equations of the chords by the pose of each view: hessian (V, 6, 6) and gradient (V, 6)."""
    hessian, gradient = np.zeros((len(rotations), 6, 6)), np.zeros((len(rotations), 6))
    for n in range(len(points)):
        k = view[n]
        rotated = times(rotations[k], points[n])
        p, inverse = direction(rotated, translations[k])
        for i in range(3):
            (j0, j1, j2), (j3, j4, j5) = derivatives_along(AXES[i], p, inverse, rotated)
            jacobian, chord = (j0, j1, j2, j3, j4, j5), p[i] - bearings[n, i]
            for r in range(6):
                weighted = weights[n] * jacobian[r]
                gradient[k, r] += weighted * chord
                for c in range(6):
                    hessian[k, r, c] += weighted * jacobian[c]
    return hessian, gradient
