"""Steps from a reference pose to repeated estimates of it, with their covariances."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from omnisight.optim.loss import geman_mcclure_weights

Array = NDArray[np.float64]

# Degrees of freedom of a pose.
POSE_DOF = 6
# Significance at which an estimate contradicts the others; false alarms must be rare in hundreds of views.
SIGNIFICANCE = 1e-6
# Rounds of iteratively reweighted least squares.
ROBUST_ROUNDS = 5


def contradiction_limit(inflation: float) -> float:
    """Return the squared distance, relative to the covariance times `inflation`, that is significant."""
    return inflation * float(chdtri(POSE_DOF, SIGNIFICANCE))


def squared_distances(steps: Array, mean: Array, information: Array) -> Array:
    """Return the squared distances (N,) of steps (N, 6) from a mean (6,), relative to their covariances (N, 6, 6)."""
    difference = steps - mean
    return np.einsum("ni,nij,nj->n", difference, information, difference)


def robust_mean(steps: Array, information: Array, limit: float) -> Array:
    """Return the mean (6,) of steps (N, 6) with Geman-McClure weights of a scale, from their median."""
    mean = np.median(steps, axis=0)
    for _ in range(ROBUST_ROUNDS):
        weights = geman_mcclure_weights(squared_distances(steps, mean, information), limit)
        weighted = weights[:, None, None] * information
        mean = np.linalg.solve(weighted.sum(0), np.einsum("nij,nj->i", weighted, steps))
    return mean
