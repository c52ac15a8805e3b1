"""How much larger the covariance of an estimate is than that of independent residuals."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Halvings of the observations into blocks: a calibration error is smooth, and only large blocks contain its
# correlation. On 20 real pairs of a fisheye rig, the standard deviations grew 4.9 times with 8 blocks, 3.1 times with
# 16, 2.3 times with 32, and 1.2 times with single observations (medians).
HALVINGS = 3
# Ratio of the variances that independent residuals exceed once in a hundred: 1 to 3 % of 60 synthetic pairs of each of
# five kinds had a ratio above 4.
MAX_CHANCE_RATIO = 4.0


def variance_ratio(problem: Any, model: Array, positions: Array) -> float:
    """Return the variance of an estimate over that of independent residuals; 1 if the difference is not significant.

    Parameters
    ----------
    problem
        A problem of `_robust_problem_kernel`, its inliers only.
    model
        (3, 4), the estimate.
    positions
        See `measured_variance_ratio`.
    """
    from omnisight.optim._robust_problem_kernel import linearized

    residuals, jacobians = linearized(problem, model)
    ratio = measured_variance_ratio(residuals, jacobians, positions)
    return ratio if ratio > MAX_CHANCE_RATIO else 1.0


def measured_variance_ratio(residuals: Array, jacobians: Array, positions: Array) -> float:
    """Return the variance of an estimate over that of independent residuals, as measured.

    Residuals of neighbouring observations are correlated by errors of the calibration and by common structures. The
    jackknife that deletes one block of neighbours at a time measures their effect, and that of a few observations on
    which the estimate depends (cluster-robust variance CR3: R. Bell and D. McCaffrey, Bias reduction in standard errors
    for linear regression with multi-stage samples, Survey Methodology 2002). The ratio is the mean over all directions
    of a step, in which it is unity for independent residuals. It is 1 if a block has fewer residuals than the model has
    parameters.

    Parameters
    ----------
    residuals, jacobians
        (N, D) of the estimate, over their standard deviations, and their derivatives (N, D, P) by a step; NaN where the
        model makes the observation impossible.
    positions
        (N, K) vectors by whose distance observations are neighbours.
    """
    from omnisight.optim._block_jackknife_kernel import deletion_variance

    _, dimension, parameters = jacobians.shape
    if np.isfinite(residuals[:, 0]).sum() <= parameters * 2**HALVINGS // dimension:
        return 1.0
    arrays = map(np.ascontiguousarray, (residuals, jacobians, positions))
    return float(deletion_variance(*arrays, HALVINGS))
