"""Compiled loops of the bundle adjustment over board points, independent of the camera model."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver, njit_helper


@njit_helper
def bend_slopes(bend, s, t):
    """Return the height of a bend at (s, t), and half of its derivatives: h = b0 s^2 + b1 s t + b2 t^2."""
    p, q = bend[0] * s + 0.5 * bend[1] * t, 0.5 * bend[1] * s + bend[2] * t
    return p * s + q * t, p, q


@njit_helper
def derivative_by_bend(derivative, bend, s, t, size, across, down, by_height):
    """Compute the derivative (3,) of a value by a bend, from its derivatives by a shift of the point on the board."""
    h, p, q = bend_slopes(bend, s, t)
    heights = s * s, s * t, t * t
    slopes = (s, 0.0), (0.5 * t, 0.5 * s), (0.0, t)
    for e in range(3):
        by_x = -2 * (heights[e] * p + h * slopes[e][0]) / (3 * size)
        by_y = -2 * (heights[e] * q + h * slopes[e][1]) / (3 * size)
        derivative[e] = across * by_x + down * by_y + by_height * heights[e]


@njit_driver
def transform_points(points, warp_basis, warp, sheet, size, bends, view, rotations, translations):
    """Return board points (N, 3) in the camera frame, and rotated but not translated; `view` (N,) selects the pose.

    A bend lifts the point (s, t) of a sheet, in units of its size, by a height h and keeps the lengths of the sheet: it
    moves the point by -h grad h/(3 size), which is right to second order for a cylinder; grad h = 2 (p, q).
    """
    transformed, rotated = np.empty((len(points), 3)), np.empty((len(points), 3))
    for n in range(len(points)):
        k = view[n]
        h, p, q = bend_slopes(bends[k], sheet[n, 0], sheet[n, 1])
        x, y = points[n, 0] - 2 * h * p / (3 * size), points[n, 1] - 2 * h * q / (3 * size)
        z = points[n, 2] + warp_basis[n, 0] * warp[0] + warp_basis[n, 1] * warp[1] + h
        for i in range(3):
            t = rotations[k, i, 0] * x + rotations[k, i, 1] * y + rotations[k, i, 2] * z
            rotated[n, i] = t
            transformed[n, i] = t + translations[k, i]
    return transformed, rotated


@njit_helper
def whitened_length(whitening, x, y):
    """Return the length of a residual (x, y) multiplied by its whitening matrix (2, 2)."""
    a, b = whitening[0, 0] * x + whitening[0, 1] * y, whitening[1, 0] * x + whitening[1, 1] * y
    return np.sqrt(a * a + b * b)


@njit_helper
def add_scaled(target, scale, six):
    """Add a multiple of six numbers to the target, in place."""
    target[0] += scale * six[0]
    target[1] += scale * six[1]
    target[2] += scale * six[2]
    target[3] += scale * six[3]
    target[4] += scale * six[4]
    target[5] += scale * six[5]


@njit_driver
def normal_equation_blocks(
    residuals,
    by_point,
    by_params,
    whitening,
    threshold,
    rotated,
    warp_basis,
    sheet,
    size,
    bends,
    terms,
    view,
    rotations,
):
    """Return weighted residuals (2 N,), their shared Jacobian, and the blocks of the normal equations per view.

    The shared Jacobian (2 N, P + 2) is by camera parameters and board warp. Per view: its product with the Jacobian by
    pose and bend (P + 2, L), the square of the latter (L, L), and the gradient (L,), with L = 6 + `terms`. `by_point`
    (3, 2, N) and `by_params` (P, 2, N) are derivatives of the pixels. Points outside the model's domain (NaN)
    contribute nothing.
    """
    count, shared, views, size_local = len(residuals), len(by_params) + 2, len(rotations), 6 + terms
    weighted, jacobian = np.empty(2 * count), np.empty((2 * count, shared))
    cross, local = np.zeros((views, shared, size_local)), np.zeros((views, size_local, size_local))
    gradient, d_bend = np.zeros((views, size_local)), np.empty(terms)
    for n in range(count):
        r0, r1 = residuals[n]
        total = r0 + r1
        for p in range(shared - 2):
            total += by_params[p, 0, n] + by_params[p, 1, n]
        if not np.isfinite(total):
            weighted[2 * n : 2 * n + 2], jacobian[2 * n : 2 * n + 2] = 0.0, 0.0
            continue
        k = view[n]
        length = whitened_length(whitening[n], r0, r1)
        huber = np.sqrt(threshold / length) if length > threshold else 1.0
        a, b, c = rotated[n]
        for i in range(2):
            w0, w1 = huber * whitening[n, i, 0], huber * whitening[n, i, 1]
            row = jacobian[2 * n + i]
            for p in range(shared - 2):
                row[p] = w0 * by_params[p, 0, n] + w1 * by_params[p, 1, n]
            x = w0 * by_point[0, 0, n] + w1 * by_point[0, 1, n]
            y = w0 * by_point[1, 0, n] + w1 * by_point[1, 1, n]
            z = w0 * by_point[2, 0, n] + w1 * by_point[2, 1, n]
            by_height = x * rotations[k, 0, 2] + y * rotations[k, 1, 2] + z * rotations[k, 2, 2]
            row[shared - 2], row[shared - 1] = by_height * warp_basis[n, 0], by_height * warp_basis[n, 1]
            # x_c = exp(w) R x + t + v:  dx_c/dw = -[R x]_x, and a row vector times -[a]_x is a x row.
            d_pose = b * z - c * y, c * x - a * z, a * y - b * x, x, y, z
            r = w0 * r0 + w1 * r1
            weighted[2 * n + i] = r
            add_scaled(gradient[k], r, d_pose)
            for q in range(6):
                add_scaled(local[k, q], d_pose[q], d_pose)
            for p in range(shared):
                if row[p] != 0.0:
                    add_scaled(cross[k, p], row[p], d_pose)
            if terms:
                across = x * rotations[k, 0, 0] + y * rotations[k, 1, 0] + z * rotations[k, 2, 0]
                down = x * rotations[k, 0, 1] + y * rotations[k, 1, 1] + z * rotations[k, 2, 1]
                derivative_by_bend(d_bend, bends[k], sheet[n, 0], sheet[n, 1], size, across, down, by_height)
                for e in range(terms):
                    gradient[k, 6 + e] += r * d_bend[e]
                    for q in range(6):
                        local[k, 6 + e, q] += d_bend[e] * d_pose[q]
                        local[k, q, 6 + e] += d_bend[e] * d_pose[q]
                    for f in range(terms):
                        local[k, 6 + e, 6 + f] += d_bend[e] * d_bend[f]
                    for p in range(shared):
                        cross[k, p, 6 + e] += row[p] * d_bend[e]
    return weighted, jacobian, cross, local, gradient


@njit_driver
def whitened_lengths(residuals, whitening, outside_cost):
    """Return the lengths (N,) of whitened residuals (N, 2); `outside_cost` where they are not finite."""
    lengths = np.empty(len(residuals))
    for n in range(len(residuals)):
        length = whitened_length(whitening[n], residuals[n, 0], residuals[n, 1])
        lengths[n] = length if np.isfinite(length) else outside_cost
    return lengths
