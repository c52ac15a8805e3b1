"""Covariance of the camera parameters, from corner noise and from the view_scatter between views."""

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.bundle_adjustment import Bundle
from omnisight.calibration.candidate import Candidate
from omnisight.calibration.estimation_options import Loss
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import State
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# Leverage of a view above which no other view determines the same direction: it cannot be compared.
MAX_LEVERAGE = 0.9
# Standard deviations of the view_scatter that are attributed to chance.
CHANCE_SIGMA = 2.0


def camera_covariance(candidate: Candidate, observations: Observations, *, loss: Loss = "huber") -> Array:
    """Return the covariance (P, P) of the camera parameters; zero for constant ones.

    The covariance due to corner noise is multiplied by the excess scatter between views, because errors of the corners
    of one image are correlated: a flexing board, a change of focus, blur and the bias of the detector move many of them
    together. Corner noise alone would then underestimate the covariance several times.
    """
    return variance_inflation(candidate, observations) * noise_covariance(candidate, observations, loss=loss)


def variance_inflation(candidate: Candidate, observations: Observations) -> float:
    """Return the factor by which the variance of the estimates exceeds that due to corner noise; at least 1.

    The part of `view_scatter` above 1 that chance explains with this number of views is removed by shrinkage.
    """
    excess = view_scatter(candidate, observations) - 1.0
    chance = CHANCE_SIGMA * np.sqrt(2 / max(len(observations) - 1, 1))
    return 1.0 + max(excess - chance**2 / excess, 0.0) if excess > 0 else 1.0


def view_scatter(candidate: Candidate, observations: Observations) -> float:
    """Return the variance of the estimates according to the scatter between views, relative to corner noise.

    Each view is one independent sample, whatever the errors within it (a cluster-robust or sandwich estimator). With H
    the normal equations after elimination of the poses, and H_k and g_k the parts of view k, the covariance is

        H^-1 (sum_k A_k g_k g_k^T A_k^T) H^-1,    A_k = L (I - L^-1 H_k L^-T)^(-1/2) L^-1,    H = L L^T

    where A_k corrects for the leverage of view k (Bell and McCaffrey, Bias reduction in standard errors for linear
    regression with multi-stage samples, Survey Methodology 28, 2002). From 20 views this matrix is too uncertain to be
    used directly; its mean over all directions gives the factor by which H^-1 is too small. Directions determined by
    one view alone, and by priors, keep the variance of corner noise. For a camera that was not fitted to these views,
    g_k is that at the minimum of the linearized cost.
    """
    state, free_parameters = candidate.state, candidate.free_parameters
    weights = ResidualWeights.estimate(state, observations)
    variance = residual_variance(weights, observations, free_parameters)
    problem = Bundle(observations, free_parameters, weights)
    normal = problem.linearize(state)
    root = normal.half_covariance()
    to_minimum = -root @ (root.T @ normal.reduced()[1])
    count = root.shape[1]
    if not count or not variance > 0:
        return 1.0
    compared, scattered = 0.0, 0.0
    for part, gradient in zip(*parts_by_view(problem, state), strict=True):
        values, vectors = np.linalg.eigh(root.T @ part @ root)
        leverage = np.where(values > MAX_LEVERAGE, 0.0, np.maximum(values, 0.0))
        score = np.where(leverage > 0, vectors.T @ (root.T @ (gradient + part @ to_minimum)), 0.0)
        compared += float(leverage.sum())
        scattered += float((score**2 / (1 - leverage)).sum())
    rest = max(count - compared, 0.0)
    return (scattered / variance + rest) / count


def noise_covariance(candidate: Candidate, observations: Observations, *, loss: Loss = "huber") -> Array:
    """Return the covariance (P, P) of the camera parameters due to independent corner noise.

    It is the inverse of the normal equations after elimination of poses and board warp, times the variance of the
    residuals corrected for the number of estimated values (Triggs et al. 2000, sec. 9).
    """
    state, free_parameters = candidate.state, candidate.free_parameters
    weights = ResidualWeights.estimate(state, observations, loss)
    normal = Bundle(observations, free_parameters, weights).linearize(state)
    count = free_parameters.directions.shape[1]
    among = normal.shared_covariance()[:count, :count]
    return (
        residual_variance(weights, observations, free_parameters)
        * free_parameters.directions
        @ among
        @ free_parameters.directions.T
    )


def residual_variance(weights: ResidualWeights, observations: Observations, free_parameters: FreeParameters) -> float:
    """Return the variance, px^2, of a corner coordinate: that of the residuals, corrected for degrees of freedom."""
    measured = observations.pixels.size
    degrees_of_freedom = measured - free_parameters.count - free_parameters.per_view * len(observations)
    return weights.sigma**2 * measured / max(degrees_of_freedom, 1)


def parts_by_view(problem: Bundle, state: State) -> tuple[Array, Array]:
    """Return each view's part of the normal equations (V, F, F) and of the gradient (V, F), its pose eliminated."""
    residuals, jacobian, cross, local, local_gradient = problem.blocks(state)
    jacobian, cross = jacobian @ problem.directions, problem.directions.T @ cross
    pose = np.linalg.pinv(local, rcond=1e-14, hermitian=True)
    gain = cross @ pose
    parts, gradients = list[Array](), list[Array]()
    for k, rows in enumerate(problem.observations.groups):
        j = jacobian[2 * rows.start : 2 * rows.stop]
        parts.append(j.T @ j - gain[k] @ cross[k].T)
        gradients.append(j.T @ residuals[2 * rows.start : 2 * rows.stop] - gain[k] @ local_gradient[k])
    return np.array(parts), np.array(gradients)
