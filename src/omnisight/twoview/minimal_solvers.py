"""Minimal solvers on bearings: motion from the smallest number of correspondences.

Bearings are unit vectors of any direction, also behind the camera. A pose (3, 4) is [R | t]: `b_from_a` means
x_b = R x_a + t. Every returned solution has positive distances along all bearings of its sample. A degenerate
sample returns no solution or wrong ones, never NaN.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.twoview import _minimal_solvers_kernel as kernel

Array = NDArray[np.float64]


def five_point(a: ArrayLike, b: ArrayLike) -> Array:
    """Compute the relative poses of two calibrated cameras from five pairs of bearings.

    Degenerate if a point is repeated, and if all points have zero parallax (rotation without translation). A plane is
    not degenerate, but can have two solutions.

    D. Nister, An efficient solution to the five-point relative pose problem, PAMI 26, 2004.

    Parameters
    ----------
    a, b
        (5, 3) bearings of both cameras.

    Returns
    -------
    poses
        (S, 3, 4) `b_from_a` with translations of unit length and S <= 10, usually 1 to 3.

    Raises
    ------
    ValueError
        If an array has another shape.
    """
    return kernel.five_point(*_sample(5, a, b))


def p3p(points: ArrayLike, bearings: ArrayLike) -> Array:
    """Compute the poses of a calibrated camera from three bearings of known points.

    Degenerate if the points are collinear or two bearings are parallel, and inaccurate if the camera lies near the
    circular cylinder through the points whose axis is normal to their plane (double solutions).

    M. Persson and K. Nordberg, Lambda Twist: an accurate fast robust perspective three point (P3P) solver, ECCV 2018;
    Y. Ding et al., Revisiting the P3P problem, CVPR 2023.

    Parameters
    ----------
    points
        (3, 3) points in the world frame.
    bearings
        (3, 3) bearings of the points in the camera frame.

    Returns
    -------
    poses
        (S, 3, 4) `camera_from_world` with S <= 4, in the unit of the points.

    Raises
    ------
    ValueError
        If an array has another shape.
    """
    return kernel.p3p(*_sample(3, points, bearings))


def _sample(count: int, *arrays: ArrayLike) -> list[Array]:
    """Return the arrays of a sample as contiguous floats; raise ValueError if one is not (count, 3)."""
    sample = [np.ascontiguousarray(array, float) for array in arrays]
    for array in sample:
        if array.shape != (count, 3):
            raise ValueError(f"expected an array of shape ({count}, 3), got {array.shape}")
    return sample
