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
    order, starts = _blocks(positions)
    j = jacobians[order] @ _whitening(jacobians.reshape(-1, parameters))
    gradients = np.add.reduceat(np.einsum("nd,ndp->np", residuals[order], j), starts)
    informations = np.add.reduceat(np.einsum("ndp,ndq->npq", j, j), starts)
    deviations = _deviations(gradients, informations)
    return float((deviations**2).sum()) * (1 - 1 / len(deviations)) / parameters


def _whitening(jacobian: Array) -> Array:
    """Return the matrix (P, P) that turns derivatives (M, P) into those by a step whose covariance is the identity."""
    values, vectors = np.linalg.eigh(jacobian.T @ jacobian)
    return np.asarray(vectors / np.sqrt(np.maximum(values, np.finfo(float).eps * values[-1])), float)


def _blocks(positions: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return an order of observations in 2^HALVINGS blocks of neighbours, and where each block starts.

    They are halved across the axis of the largest extent.
    """
    from scipy.spatial import KDTree  # slow to import

    sizes = [len(positions)]
    for _ in range(HALVINGS):
        sizes = [part for size in sizes for part in (size // 2, size - size // 2)]
    tree = KDTree(positions, leafsize=max(sizes))
    return tree.indices, np.cumsum([0, *sizes[:-1]])


def _deviations(gradients: Array, informations: Array) -> Array:
    """Return the changes (B, P) of the estimate if each of B blocks is deleted; the sum of informations is I."""
    values, vectors = np.linalg.eigh(np.eye(gradients.shape[1]) - informations)
    along = np.einsum("bpk,bp->bk", vectors, gradients)
    # What only one block determines has no change.
    changes = np.divide(along, values, out=np.zeros_like(along), where=values > np.finfo(float).eps)
    return np.einsum("bpk,bk->bp", vectors, changes)
