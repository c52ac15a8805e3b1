"""Compiled leverages of points: how much of their residuals the cameras that are fitted to them absorb."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver
from omnisight.sfm._bundle_kernel import block_origin
from omnisight.sfm._point_kernel import information_of_point


@njit_driver
def point_leverages(
    starts, columns, groups, parts, residuals, by_camera, by_point, layout, values, moved, first, last, leverages
):
    """Fill the leverages (P,) of the points first ... last, from 0 to 1: means over their independent residuals.

    They are the diagonal of J_c A J_c^T without its part along the derivatives J_p by the point, where A is the
    covariance of the cameras. For the parameters see `point_covariances`; `moved` (P, 3, 3) is the part of the
    covariances of the points that the cameras cause.
    """
    gradient = np.empty(3)
    for n in range(first, last):
        start, end = starts[n], starts[n + 1]
        a, b, c, d, e, f = information_of_point(by_point, residuals, start, end, gradient)
        m = moved[n]
        total = -(a * m[0, 0] + d * m[1, 1] + f * m[2, 2] + 2.0 * (b * m[0, 1] + c * m[0, 2] + e * m[1, 2]))
        for i in range(start, end):
            for p in range(len(parts) - 1):
                for q in range(len(parts) - 1):
                    group, other = groups[i, p], groups[i, q]
                    if group < 0 or other < 0:
                        continue
                    origin, width = block_origin(layout, max(group, other), min(group, other))
                    for r in range(parts[p], parts[p + 1]):
                        row = columns[i, r]
                        for s in range(parts[q], parts[q + 1]):
                            column = columns[i, s]
                            if row >= 0 and column >= 0:
                                product = (
                                    by_camera[i, 0, r] * by_camera[i, 0, s] + by_camera[i, 1, r] * by_camera[i, 1, s]
                                )
                                total += product * values[origin + max(row, column) * width + min(row, column)]
        leverages[n] = total / max(2 * (end - start) - 3, 1)
