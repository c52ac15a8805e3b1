"""The compiled part of `refine`: what is done corner by corner, whatever the camera model."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import inner, outer


@outer
def place(corners, bows, warp, view, rotations, translations):
    """Give corners (N, 3) of boards in the camera's frame, and only turned into it; each of the view (N,) it is in."""
    points, turned = np.empty((len(corners), 3)), np.empty((len(corners), 3))
    for n in range(len(corners)):
        x, y = corners[n, 0], corners[n, 1]
        z = corners[n, 2] + bows[n, 0] * warp[0] + bows[n, 1] * warp[1]
        k = view[n]
        for i in range(3):
            t = rotations[k, i, 0] * x + rotations[k, i, 1] * y + rotations[k, i, 2] * z
            turned[n, i] = t
            points[n, i] = t + translations[k, i]
    return points, turned


@inner
def weighted_length(root, x, y):
    """Give the length of a residual (x, y) times its root (2, 2)."""
    a, b = root[0, 0] * x + root[0, 1] * y, root[1, 0] * x + root[1, 1] * y
    return np.sqrt(a * a + b * b)


@inner
def add(to, times, six):
    """Add so many times six numbers to others."""
    to[0] += times * six[0]
    to[1] += times * six[1]
    to[2] += times * six[2]
    to[3] += times * six[3]
    to[4] += times * six[4]
    to[5] += times * six[5]


@outer
def weighted(residuals, by_point, by_params, roots, threshold, turned, bows, view, rotations):
    """Give residuals (N, 2) weighted (2 N,) and what they depend on, as far as boards do not share it.

    Beside them: their Jacobian (2 N, P + 2) by the camera and the board's bend, and per view its product
    (P + 2, 6) with the Jacobian by the pose, that Jacobian's square (6, 6) and its product with them (6,).
    `by_point` (3, 2, N) and `by_params` (P, 2, N) are the pixels' derivatives. A corner outside the model's domain
    counts nothing.
    """
    count, shared, views = len(residuals), len(by_params) + 2, len(rotations)
    made, jacobian = np.empty(2 * count), np.empty((2 * count, shared))
    cross, local, gradient = np.zeros((views, shared, 6)), np.zeros((views, 6, 6)), np.zeros((views, 6))
    for n in range(count):
        r0, r1 = residuals[n]
        total = r0 + r1
        for p in range(shared - 2):
            total += by_params[p, 0, n] + by_params[p, 1, n]
        if not np.isfinite(total):
            made[2 * n : 2 * n + 2], jacobian[2 * n : 2 * n + 2] = 0.0, 0.0
            continue
        k = view[n]
        length = weighted_length(roots[n], r0, r1)
        root = np.sqrt(threshold / length) if length > threshold else 1.0
        a, b, c = turned[n]
        for i in range(2):
            w0, w1 = root * roots[n, i, 0], root * roots[n, i, 1]
            row = jacobian[2 * n + i]
            for p in range(shared - 2):
                row[p] = w0 * by_params[p, 0, n] + w1 * by_params[p, 1, n]
            x = w0 * by_point[0, 0, n] + w1 * by_point[0, 1, n]
            y = w0 * by_point[1, 0, n] + w1 * by_point[1, 1, n]
            z = w0 * by_point[2, 0, n] + w1 * by_point[2, 1, n]
            back = x * rotations[k, 0, 2] + y * rotations[k, 1, 2] + z * rotations[k, 2, 2]
            row[shared - 2], row[shared - 1] = back * bows[n, 0], back * bows[n, 1]
            # x_c = exp(w) R x + t + v:  dx_c/dw = -[R x]_x, and a row vector times -[a]_x is a x row.
            d_pose = b * z - c * y, c * x - a * z, a * y - b * x, x, y, z
            r = w0 * r0 + w1 * r1
            made[2 * n + i] = r
            add(gradient[k], r, d_pose)
            for q in range(6):
                add(local[k, q], d_pose[q], d_pose)
            for p in range(shared):
                if row[p] != 0.0:
                    add(cross[k, p], row[p], d_pose)
    return made, jacobian, cross, local, gradient


@outer
def weighted_lengths(residuals, roots, outside):
    """Give the lengths (N,) of residuals (N, 2) times their roots; `outside` where there is none."""
    lengths = np.empty(len(residuals))
    for n in range(len(residuals)):
        length = weighted_length(roots[n], residuals[n, 0], residuals[n, 1])
        lengths[n] = length if np.isfinite(length) else outside
    return lengths
