"""The epipolar constraint of bearings: residuals, their derivatives, and the test of positive distances."""

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.twoview.bearing_pairs import BearingPairs

Array = NDArray[np.float64]


def epipolar_residuals(pairs: BearingPairs, b_from_a: Pose) -> tuple[Array, Array]:
    """Return the epipolar residuals (N,) over their standard deviations, and derivatives (N, 6) by `Pose.moved` steps.

    With p = R a, q = b, m = t x p and n = t x q, the residual is e = q . m. Its variance is m^T S_b m + n^T S_a n, with
    both covariances in frame b: the squared quotient is, to first order, the least sum of squared corrections of both
    bearings that makes them meet (P. Sampson 1982; on the sphere: Hartley and Zisserman, ch. 11.4).
    """
    from omnisight.twoview._epipolar_kernel import residuals_and_derivatives

    arrays = pairs.a, pairs.b, pairs.covariance_a, pairs.covariance_b, b_from_a.rotation, b_from_a.translation
    return residuals_and_derivatives(*map(np.ascontiguousarray, arrays))


def is_behind(pairs: BearingPairs, b_from_a: Pose) -> NDArray[np.bool_]:
    """Return whether a distance (N,) along a bearing is negative, although the parallax is larger than its noise."""
    from omnisight.twoview._epipolar_kernel import behind

    arrays = pairs.a, pairs.b, pairs.variance, b_from_a.rotation, b_from_a.translation
    return behind(*map(np.ascontiguousarray, arrays))
