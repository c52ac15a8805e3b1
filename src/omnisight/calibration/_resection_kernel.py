"""The compiled part of `pose`: what is done corner by corner."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver


@njit_driver
def squared_chords(points, view, rotations, translations, bearings):
    """Give the squared distances (N,) between bearings and the directions of points, each posed as its view is."""
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
    """Give the normal equations by view, (V, 6, 6) and (V, 6), of these distances by a turn and a shift of each."""
    hessian, gradient = np.zeros((len(rotations), 6, 6)), np.zeros((len(rotations), 6))
    turned, seen, by = np.empty(3), np.empty(3), np.empty(6)
    for n in range(len(points)):
        k = view[n]
        length = 0.0
        for i in range(3):
            turned[i] = 0.0
            for j in range(3):
                turned[i] += rotations[k, i, j] * points[n, j]
            seen[i] = turned[i] + translations[k, i]
            length += seen[i] * seen[i]
        over = 1.0 / max(np.sqrt(length), 1e-300)
        for i in range(3):
            seen[i] *= over
        for i in range(3):
            # p = (y + t)/|y + t| with y = R X, turned by w and moved by v:  dp = (I - p p^T)(w x y + v)/|y + t|.
            for j in range(3):
                by[3 + j] = ((1.0 if i == j else 0.0) - seen[i] * seen[j]) * over
            for j in range(3):
                after, last = (j + 1) % 3, (j + 2) % 3
                by[j] = turned[after] * by[3 + last] - turned[last] * by[3 + after]
            off = seen[i] - bearings[n, i]
            for p in range(6):
                weighted = weights[n] * by[p]
                gradient[k, p] += weighted * off
                for q in range(6):
                    hessian[k, p, q] += weighted * by[q]
    return hessian, gradient
