"""Compiled loops of the resection over board points."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver


@njit_driver
def squared_chords(points, view, rotations, translations, bearings):
    """Return the squared chords (N,) between bearings and the directions of points posed by their view."""
    squares = np.empty(len(points))
    for n in range(len(points)):
        r, t = rotations[view[n]], translations[view[n]]
        x, y, z = points[n]
        a = r[0, 0] * x + r[0, 1] * y + r[0, 2] * z + t[0]
        b = r[1, 0] * x + r[1, 1] * y + r[1, 2] * z + t[1]
        c = r[2, 0] * x + r[2, 1] * y + r[2, 2] * z + t[2]
        over = 1.0 / max(np.sqrt(a * a + b * b + c * c), 1e-300)
        a, b, c = a * over - bearings[n, 0], b * over - bearings[n, 1], c * over - bearings[n, 2]
        squares[n] = a * a + b * b + c * c
    return squares


@njit_driver
def chord_normal_equations(points, view, rotations, translations, bearings, weights):
    """Return the normal equations of the chords by the pose of each view: hessian (V, 6, 6) and gradient (V, 6)."""
    hessian, gradient = np.zeros((len(rotations), 6, 6)), np.zeros((len(rotations), 6))
    rotated, direction, jacobian = np.empty(3), np.empty(3), np.empty(6)
    for n in range(len(points)):
        k = view[n]
        length = 0.0
        for i in range(3):
            rotated[i] = 0.0
            for j in range(3):
                rotated[i] += rotations[k, i, j] * points[n, j]
            direction[i] = rotated[i] + translations[k, i]
            length += direction[i] * direction[i]
        inverse_length = 1.0 / max(np.sqrt(length), 1e-300)
        for i in range(3):
            direction[i] *= inverse_length
        for i in range(3):
            # p = (y + t)/|y + t| with y = R X, rotated by w and translated by v:  dp = (I - p p^T)(w x y + v)/|y + t|.
            for j in range(3):
                jacobian[3 + j] = ((1.0 if i == j else 0.0) - direction[i] * direction[j]) * inverse_length
            for j in range(3):
                after, last = (j + 1) % 3, (j + 2) % 3
                jacobian[j] = rotated[after] * jacobian[3 + last] - rotated[last] * jacobian[3 + after]
            chord = direction[i] - bearings[n, i]
            for p in range(6):
                weighted = weights[n] * jacobian[p]
                gradient[k, p] += weighted * chord
                for q in range(6):
                    hessian[k, p, q] += weighted * jacobian[q]
    return hessian, gradient
