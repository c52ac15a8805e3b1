"""Compiled loops of the bundle adjustment of poses and points over observations, sorted by point.

An observation is a ray of a sensor: an origin o and a bearing b with two whitened tangents A (2, 3), A b = 0. With the
point x_s = S (F X) in the sensor frame, F = rig_from_world, S = sensor_from_rig and u the direction of x_s - o, its
residual is A u: to first order the whitened residual in pixels, without the poles and seams of images.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

from functools import partial

import numpy as np

from omnisight.compiled import STREAMLINED, njit_driver, njit_helper
from omnisight.optim._multifrontal_kernel import block_offset
from omnisight.sfm._point_kernel import damped_inverse, information_of_point, point_direction
from omnisight.twoview._small_vectors_kernel import cross, dot, transposed_times

# Derivatives by a pose.
POSE = 6


@njit_driver
def squared_lengths(
    frame_poses, sensor_poses, points, frame, sensor, point, origins, bearings, axes, first, last, squares
):
    """Fill the squared lengths (M,) of whitened residuals first ... last; inf for points behind their rays."""
    for i in range(first, last):
        _, _, u, _ = point_direction(frame_poses[frame[i]], sensor_poses[sensor[i]], points[point[i]], origins[i])
        squares[i] = np.inf if dot(u, bearings[i]) <= 0.0 else dot(axes[i, 0], u) ** 2 + dot(axes[i, 1], u) ** 2


@njit_driver
def linearize(
    frame_poses,
    sensor_poses,
    points,
    frame,
    sensor,
    point,
    origins,
    axes,
    weights,
    first,
    last,
    residuals,
    by_camera,
    by_point,
):
    """Fill weighted residuals (M, 2) and their derivatives by the poses (M, 2, 6 or 12) and by the point (M, 2, 3).

    Those of the observations first ... last are filled. The first six columns are of a step of the frame, the next of
    a step of the sensor, if there is room for them.
    """
    sensors_are_free = by_camera.shape[2] >= 2 * POSE
    for i in range(first, last):
        frame_pose, sensor_pose = frame_poses[frame[i]], sensor_poses[sensor[i]]
        a, b, u, inverse = point_direction(frame_pose, sensor_pose, points[point[i]], origins[i])
        root = np.sqrt(weights[i])
        for k in range(2):
            row = axes[i, k]
            along = dot(row, u)
            residuals[i, k] = root * along
            scale = root * inverse
            d = scale * (row[0] - along * u[0]), scale * (row[1] - along * u[1]), scale * (row[2] - along * u[2])
            in_rig = transposed_times(sensor_pose, d)
            # x changes by w x (R x) + v, and d . (w x c) = w . (c x d).
            turn = cross(a, in_rig)
            in_world = transposed_times(frame_pose, in_rig)
            for c in range(3):
                by_camera[i, k, c], by_camera[i, k, 3 + c] = turn[c], in_rig[c]
                by_point[i, k, c] = in_world[c]
            if sensors_are_free:
                turn = cross(b, d)
                for c in range(3):
                    by_camera[i, k, POSE + c], by_camera[i, k, POSE + 3 + c] = turn[c], d[c]


@njit_helper
def inverse_of_point(by_point, residuals, first, last, damping, inverse, gradient):
    """Fill the inverse (3, 3) of the damped information of a point, and its gradient (3,)."""
    damped_inverse(information_of_point(by_point, residuals, first, last, gradient), damping, inverse)


@njit_helper
def block_origin(layout, high, low):
    """Return the address that the value of row 0 and column 0 would have in the block of two groups, and its width."""
    starts, row_starts, block_columns, offsets = layout
    width = starts[low + 1] - starts[low]
    return block_offset(row_starts, block_columns, offsets, high, low) - starts[high] * width - starts[low], width


@njit_helper
def _is_pose(columns, parts, i, part):
    """Return whether a part of the derivatives of an observation is that of a pose without fixed elements."""
    first, last = parts[part], parts[part + 1] - 1
    return last - first == POSE - 1 and columns[i, first] >= 0 and columns[i, last] - columns[i, first] == POSE - 1


@njit_helper
def _subtract_product(schur, address, width, gain, first_row, terms, first_column):
    """Subtract G^T W of a gain and cross terms (3, L) of two poses from a block of values."""
    for r in range(POSE):
        g0, g1, g2 = gain[0, first_row + r], gain[1, first_row + r], gain[2, first_row + r]
        at = address + r * width
        for c in range(POSE):
            k = first_column + c
            schur[at + c] -= g0 * terms[0, k] + g1 * terms[1, k] + g2 * terms[2, k]


@partial(njit_driver, **STREAMLINED)
def reduce_points(
    starts,
    columns,
    groups,
    parts,
    residuals,
    by_camera,
    by_point,
    damping,
    first,
    last,
    layout,
    schur,
    right,
    diagonal,
    inverse,
    gradient,
    cross_terms,
    gains,
):
    """Add the points first ... last to the values of the Schur complement, in place.

    Also add to its right side (C,) and to the diagonal (C,) of the normal equations of the cameras.

    Parameters
    ----------
    starts
        (P + 1,) first observation of each point.
    columns
        (M, L) column of each derivative by a camera; -1 if it is fixed.
    groups, parts
        (M, K) groups of the columns of the parts of each row of derivatives, and the first derivatives (K + 1,) of each
        part; -1 if all of a part are fixed.
    layout
        Starts, row starts, columns and offsets of the `BlockPattern` of the Schur complement.
    inverse, gradient, cross_terms, gains
        (3, 3), (3,), and (N, 3, L) for the N observations of any point: memory of intermediate results.
    """
    size = columns.shape[1]
    for n in range(first, last):
        start, end = starts[n], starts[n + 1]
        inverse_of_point(by_point, residuals, start, end, damping, inverse, gradient)
        for m in range(end - start):
            i = start + m
            for r in range(size):
                b0, b1 = by_camera[i, 0, r], by_camera[i, 1, r]
                w0 = b0 * by_point[i, 0, 0] + b1 * by_point[i, 1, 0]
                w1 = b0 * by_point[i, 0, 1] + b1 * by_point[i, 1, 1]
                w2 = b0 * by_point[i, 0, 2] + b1 * by_point[i, 1, 2]
                g0, g1, g2 = dot(inverse[0], (w0, w1, w2)), dot(inverse[1], (w0, w1, w2)), dot(inverse[2], (w0, w1, w2))
                cross_terms[m, 0, r], cross_terms[m, 1, r], cross_terms[m, 2, r] = w0, w1, w2
                gains[m, 0, r], gains[m, 1, r], gains[m, 2, r] = g0, g1, g2
                row = columns[i, r]
                if row >= 0:
                    right[row] += b0 * residuals[i, 0] + b1 * residuals[i, 1] - dot((g0, g1, g2), gradient)
                    diagonal[row] += b0 * b0 + b1 * b1
            for other in range(m + 1):
                j = start + other
                for p in range(len(parts) - 1):
                    # The groups of the parts of one observation increase: the first triangle of its blocks suffices.
                    for q in range(p + 1 if m == other else len(parts) - 1):
                        group, of_other = groups[i, p], groups[j, q]
                        if group < 0 or of_other < 0:
                            continue
                        origin, width = block_origin(layout, max(group, of_other), min(group, of_other))
                        row, column = columns[i, parts[p]], columns[j, parts[q]]
                        if (
                            row != column
                            and m != other
                            and _is_pose(columns, parts, i, p)
                            and _is_pose(columns, parts, j, q)
                        ):
                            if row > column:
                                address = origin + row * width + column
                                _subtract_product(
                                    schur, address, width, gains[m], parts[p], cross_terms[other], parts[q]
                                )
                            else:
                                address = origin + column * width + row
                                _subtract_product(
                                    schur, address, width, gains[other], parts[q], cross_terms[m], parts[p]
                                )
                            continue
                        # Strides instead of the order of each row and column: the loop takes 13 % less time.
                        by_row, by_column = (width, 1) if group >= of_other else (1, width)
                        for r in range(parts[p], parts[p + 1]):
                            row = columns[i, r]
                            if row < 0:
                                continue
                            g0, g1, g2 = gains[m, 0, r], gains[m, 1, r], gains[m, 2, r]
                            along_row = origin + row * by_row
                            for c in range(parts[q], parts[q + 1]):
                                column = columns[j, c]
                                if column < 0 or (m == other and column > row):
                                    continue
                                w0, w1, w2 = (
                                    cross_terms[other, 0, c],
                                    cross_terms[other, 1, c],
                                    cross_terms[other, 2, c],
                                )
                                value = g0 * w0 + g1 * w1 + g2 * w2
                                if m == other:
                                    value -= by_camera[i, 0, r] * by_camera[i, 0, c]
                                    value -= by_camera[i, 1, r] * by_camera[i, 1, c]
                                if group != of_other or m == other:
                                    schur[along_row + column * by_column] -= value
                                else:  # observations that share a parameter add to its square twice
                                    address = origin + max(row, column) * width + min(row, column)
                                    schur[address] -= 2.0 * value if row == column else value


@njit_driver
def solve_points(starts, columns, residuals, by_camera, by_point, damping, first, last, step, moves):
    """Fill the steps (P, 3) of the points first ... last, given that of the cameras (C,)."""
    inverse, gradient = np.empty((3, 3)), np.empty(3)
    for n in range(first, last):
        inverse_of_point(by_point, residuals, starts[n], starts[n + 1], damping, inverse, gradient)
        for i in range(starts[n], starts[n + 1]):
            for k in range(2):
                moved = 0.0
                for r in range(columns.shape[1]):
                    if columns[i, r] >= 0:
                        moved += by_camera[i, k, r] * step[columns[i, r]]
                for c in range(3):
                    gradient[c] += by_point[i, k, c] * moved
        for r in range(3):
            moves[n, r] = -dot(inverse[r], gradient)


@njit_driver
def linear_decrease(columns, point, residuals, by_camera, by_point, step, moves):
    """Return the decrease of the linearized cost along steps of the cameras (C,) and of the points (P, 3)."""
    total = 0.0
    for i in range(len(point)):
        for k in range(2):
            change = dot(by_point[i, k], moves[point[i]])
            for r in range(columns.shape[1]):
                if columns[i, r] >= 0:
                    change += by_camera[i, k, r] * step[columns[i, r]]
            total -= change * (residuals[i, k] + 0.5 * change)
    return total


@njit_driver
def point_covariances(
    starts, columns, groups, parts, residuals, by_camera, by_point, layout, values, noise, first, last, covariance
):
    """Fill the covariances (P, 3, 3) of the points first ... last, given the values of that of the cameras.

    The part of their own observations is multiplied by `noise`, the variance of the residuals. For the other parameters
    see `reduce_points`.
    """
    size = columns.shape[1]
    inverse, gradient = np.empty((3, 3)), np.empty(3)
    for n in range(first, last):
        start, end = starts[n], starts[n + 1]
        inverse_of_point(by_point, residuals, start, end, 0.0, inverse, gradient)
        gains = np.zeros((end - start, size, 3))
        for m in range(end - start):
            for r in range(size):
                for k in range(2):
                    for c in range(3):
                        gains[m, r, c] += by_camera[start + m, k, r] * dot(inverse[c], by_point[start + m, k])
        for p in range(3):
            for q in range(3):
                covariance[n, p, q] = noise * inverse[p, q]
        for m in range(end - start):
            for other in range(end - start):
                for p in range(len(parts) - 1):
                    for q in range(len(parts) - 1):
                        group, of_other = groups[start + m, p], groups[start + other, q]
                        if group < 0 or of_other < 0:
                            continue
                        origin, width = block_origin(layout, max(group, of_other), min(group, of_other))
                        for r in range(parts[p], parts[p + 1]):
                            row = columns[start + m, r]
                            for c in range(parts[q], parts[q + 1]):
                                column = columns[start + other, c]
                                if row < 0 or column < 0:
                                    continue
                                value = values[origin + max(row, column) * width + min(row, column)]
                                for k in range(3):
                                    for d in range(3):
                                        covariance[n, k, d] += value * gains[m, r, k] * gains[other, c, d]
