"""The epipolar constraint of bearings: residuals, their derivatives and distances along bearings."""

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.twoview.bearing_pairs import BearingPairs

Array = NDArray[np.float64]

# Squared parallax in units of its variance below which the sign of a distance is noise.
MIN_SQUARED_PARALLAX = 9.0


def epipolar_residuals(pairs: BearingPairs, b_from_a: Pose) -> tuple[Array, Array]:
    """Return the epipolar residuals (N,) over their standard deviations, and derivatives (N, 6) by `Pose.moved` steps.

    With p = R a, q = b, m = t x p and n = t x q, the residual is e = q . m. Its variance is m^T S_b m + n^T S_a n, with
    both covariances in frame b: the squared quotient is, to first order, the least sum of squared corrections of both
    bearings that makes them meet (P. Sampson 1982; on the sphere: Hartley and Zisserman, ch. 11.4).
    """
    from omnisight.twoview._epipolar_kernel import residuals_and_derivatives

    arrays = pairs.a, pairs.b, pairs.covariance_a, pairs.covariance_b, b_from_a.rotation, b_from_a.translation
    return residuals_and_derivatives(*map(np.ascontiguousarray, arrays))


def distances(a: Array, b: Array, b_from_a: Pose) -> tuple[Array, Array, Array]:
    """Return the distances (N,) along bearings a and b to the points nearest to both rays, and the squared parallax.

    With p = R a, q = b: lambda_a p + t = lambda_b q. Distances are inf for parallel bearings; the third result is the
    squared length of the chord between p and q, which is that of the parallax, and 4 for opposite bearings.
    """
    from omnisight.twoview import _epipolar_kernel

    arrays = a, b, b_from_a.rotation, b_from_a.translation
    return _epipolar_kernel.distances(*map(np.ascontiguousarray, arrays))


def is_behind(pairs: BearingPairs, b_from_a: Pose) -> NDArray[np.bool_]:
    """Return whether a distance (N,) is negative, although the parallax is larger than its noise."""
    along_a, along_b, squared_parallax = distances(pairs.a, pairs.b, b_from_a)
    return (np.minimum(along_a, along_b) < 0) & (squared_parallax > MIN_SQUARED_PARALLAX * pairs.variance)
