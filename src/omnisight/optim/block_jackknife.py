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

    See `measured_variance_ratio`.
    """
    ratio = measured_variance_ratio(problem, model, positions)
    return ratio if ratio > MAX_CHANCE_RATIO else 1.0


def measured_variance_ratio(problem: Any, model: Array, positions: Array) -> float:
    """Return the variance of an estimate over that of independent residuals, as measured.

    Residuals of neighbouring observations are correlated by errors of the calibration and by common structures. The
    jackknife that deletes one block of neighbours at a time measures their effect, and that of a few observations on
    which the estimate depends (cluster-robust variance CR3: R. Bell and D. McCaffrey, Bias reduction in standard errors
    for linear regression with multi-stage samples, Survey Methodology 2002). The ratio is the mean over all directions
    of a step, in which it is unity for independent residuals. It is 1 if a block has fewer residuals than the model has
    parameters.

    Parameters
    ----------
    problem
        A problem of `_robust_problem_kernel`, its inliers only.
    model
        (3, 4), the estimate.
    positions
        (N, K) vectors by whose distance observations are neighbours.
    """
    from omnisight.optim._robust_problem_kernel import linearized

    residuals, jacobians = linearized(problem, model)
    possible = np.isfinite(residuals).all(axis=1)
    residuals, jacobians, positions = residuals[possible], jacobians[possible], positions[possible]
    parameters = jacobians.shape[2]
    if len(residuals) <= parameters * 2**HALVINGS // residuals.shape[1]:
        return 1.0
    gradients, informations = [], []
    whitened = _whitened(jacobians)
    for block in _blocks(positions):
        j = whitened[block].reshape(-1, parameters)
        gradients.append(j.T @ residuals[block].reshape(-1))
        informations.append(j.T @ j)
    deviations = _deviations(np.array(gradients), np.array(informations))
    return float((deviations**2).sum()) * (1 - 1 / len(deviations)) / parameters


def _whitened(jacobians: Array) -> Array:
    """Return derivatives (N, D, P) by a step whose covariance is the identity."""
    q, _ = np.linalg.qr(jacobians.reshape(-1, jacobians.shape[2]))
    return np.asarray(q, float).reshape(jacobians.shape)


def _blocks(positions: Array) -> list[NDArray[np.intp]]:
    """Return the indices of 2^HALVINGS blocks of neighbours, halved across the axis of the largest extent."""
    from scipy.spatial import KDTree  # slow to import

    sizes = [len(positions)]
    for _ in range(HALVINGS):
        sizes = [part for size in sizes for part in (size // 2, size - size // 2)]
    tree = KDTree(positions, leafsize=max(sizes))
    return np.split(tree.indices, np.cumsum(sizes)[:-1])


def _deviations(gradients: Array, informations: Array) -> Array:
    """Return the changes (B, P) of the estimate if each of B blocks is deleted; the sum of informations is I."""
    kept = np.eye(gradients.shape[1]) - informations
    return (np.linalg.pinv(kept, hermitian=True) @ gradients[..., None])[..., 0]
