"""Minimal solvers on bearings: motion from the smallest number of correspondences.

Bearings are unit vectors of any direction, also behind the camera. A relative pose [R | t] is `b_from_a`:
x_b = R x_a + t.
Every returned solution has positive distances along all bearings of its sample. A degenerate sample returns no solution
or wrong ones, never NaN.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.twoview import _minimal_solvers_kernel as kernel

Array = NDArray[np.float64]


def five_point(a: ArrayLike, b: ArrayLike) -> Array:
    """Compute the relative poses of two calibrated cameras from five pairs of bearings.

    Degenerate if a point is repeated, and if all points have zero parallax (rotation without translation). A plane is
    not degenerate, but can have two solutions. The translation has unit length.

    D. Nister, An efficient solution to the five-point relative pose problem, PAMI 26, 2004.

    Parameters
    ----------
    a, b
        (5, 3) bearings of both cameras.

    Returns
    -------
    poses
        (S, 3, 4) with S <= 10, usually 1 to 3.

    Raises
    ------
    ValueError
        If an array has another shape.
    """
    return kernel.five_point(*_sample(5, a, b))


def _sample(count: int, *arrays: ArrayLike) -> list[Array]:
    """Return the arrays of a sample as contiguous floats; raise ValueError if one is not (count, 3)."""
    sample = [np.ascontiguousarray(array, float) for array in arrays]
    for array in sample:
        if array.shape != (count, 3):
            raise ValueError(f"expected an array of shape ({count}, 3), got {array.shape}")
    return sample
