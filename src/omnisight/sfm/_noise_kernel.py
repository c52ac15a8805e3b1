"""Compiled correction of residuals for the points that were fitted to them.

The residuals r of a point with derivatives J by it are r = (I - H) e at the least-squares optimum, where e are the
errors of the observations and H = J (J^T J)^-1 J^T. Errors of unit variance thus leave residuals with covariance I - H.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver
from omnisight.sfm._bundle_kernel import inverse_of_point
from omnisight.twoview._small_vectors_kernel import dot

# Smaller eigenvalue of the covariance of a residual over the larger one, below which it has one dimension: those of
# points in two images are zero but for rounding.
MIN_EIGENVALUE_RATIO = 1e-6


@njit_driver
def correct_for_points(starts, residuals, by_point, first, last, squares, dimensions, shares):
    """Fill squared residuals (M,) of errors of unit variance, their dimensions (M,), and their shares (M,) of it.

    Those of the points first ... last are filled. The shares of a point, times the dimensions, add up to its number of
    residuals minus three.

    Parameters
    ----------
    starts
        (P + 1,) first observation of each point.
    residuals, by_point
        (M, 2) and (M, 2, 3), whitened.
    """
    inverse, gradient, move = np.empty((3, 3)), np.empty(3), np.empty(3)
    for n in range(first, last):
        inverse_of_point(by_point, residuals, starts[n], starts[n + 1], 0.0, inverse, gradient)
        for c in range(3):
            move[c] = dot(inverse[c], gradient)
        for i in range(starts[n], starts[n + 1]):
            first_row, second_row = by_point[i, 0], by_point[i, 1]
            x, y = residuals[i, 0] - dot(first_row, move), residuals[i, 1] - dot(second_row, move)
            along, across = np.empty(3), np.empty(3)
            for c in range(3):
                along[c], across[c] = dot(inverse[c], first_row), dot(inverse[c], second_row)
            a, b, c = 1.0 - dot(first_row, along), -dot(first_row, across), 1.0 - dot(second_row, across)
            trace, determinant = max(a + c, 1e-300), a * c - b * b
            if determinant > MIN_EIGENVALUE_RATIO * trace * trace:
                squares[i] = (c * x * x - 2.0 * b * x * y + a * y * y) / determinant
                dimensions[i], shares[i] = 2.0, 0.5 * trace
            else:
                squares[i] = (x * x + y * y) / trace
                dimensions[i], shares[i] = 1.0, trace
