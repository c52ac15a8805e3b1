"""Maximum likelihood with outliers: residuals are a mixture of a Gaussian and of outliers with a known density."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
State = TypeVar("State")

# Rounds of expectation and maximization. They end when a step, in units of its standard deviation, is below the
# tolerance, and the scale changes by less than this fraction.
MAX_ROUNDS, TOLERANCE = 50, 1e-3
# Smallest scale of the noise: residuals of exact correspondences are rounding.
MIN_SCALE = 1e-6
# Inliers and outliers that are added to those of a neighbourhood, so that no share is 0 or 1.
PSEUDO_COUNT = 0.5


@dataclass(frozen=True)
class Mixture(Generic[State]):
    """The fit of a mixture.

    Attributes
    ----------
    state
        The state of the model.
    probability
        (N,), that each observation is an inlier.
    scale
        Standard deviation of the inliers' residuals.
    covariance
        (P, P) covariance of a step of the state.
    """

    state: State
    probability: Array
    scale: float
    covariance: Array


def fit_mixture(
    linearize: Callable[[State], tuple[Array, Array]],
    start: State,
    *,
    retract: Callable[[State, Array], State],
    outlier_density: float,
    feature: Callable[[State], Array | None],
    scale: float | None = None,
) -> Mixture[State]:
    """Estimate a state, and the scale of its residuals unless it is known, by expectation maximization.

    Each round takes one Gauss-Newton step (A. Dempster, N. Laird, D. Rubin, Maximum likelihood from incomplete data via
    the EM algorithm, 1977). The covariance is the inverse of the observed information: what is unknown about which
    observations are inliers is subtracted (T. Louis, Finding the observed information matrix when using the EM
    algorithm, 1982).

    Parameters
    ----------
    linearize
        state -> residuals (N, D), and their Jacobians (N, D, P) by a step. Rows of NaN are outliers.
    start
        Initial state, close to the solution.
    retract
        state, step (P,) -> state.
    outlier_density
        Density of the residual of an outlier near zero.
    scale
        Standard deviation of the inliers' residuals; None if it is to be estimated, starting from 1.
    feature
        state -> quantity (N,) on which the share of outliers depends; None if it is the same for all.
    """
    state, sigma = start, 1.0 if scale is None else scale
    residuals, jacobian = linearize(state)
    share = np.full(len(residuals), 0.5)
    for _ in range(MAX_ROUNDS):
        probability = _inlier_probability(residuals, sigma, share, outlier_density)
        share = _outlier_share(probability, feature(state))
        gradient, information = _normal_equations(residuals, jacobian, probability)
        step = -np.asarray(np.linalg.lstsq(information, gradient, rcond=None)[0], float)
        state = retract(state, step)
        residuals, jacobian = linearize(state)
        before = sigma
        if scale is None:
            squares = np.nan_to_num((residuals**2).sum(axis=1))
            freedom = residuals.shape[1] * probability.sum() - len(step)
            sigma = max(float(np.sqrt(probability @ squares / max(freedom, 1.0))), MIN_SCALE)
        if step @ information @ step <= (TOLERANCE * sigma) ** 2 and abs(sigma - before) <= TOLERANCE * before:
            break
    probability = _inlier_probability(residuals, sigma, share, outlier_density)
    unknown = (1 - probability) * np.nan_to_num((residuals**2).sum(axis=1)) / (sigma**2 * residuals.shape[1])
    _, information = _normal_equations(residuals, jacobian, probability * (1 - unknown))
    covariance = sigma**2 * np.linalg.pinv(information, hermitian=True)
    return Mixture(state, probability, sigma, np.asarray(covariance, float))


def _outlier_share(probability: Array, feature: Array | None) -> Array:
    """Return the share of outliers (N,) among the other observations, those with a similar feature if there is one."""
    count = len(probability)
    if feature is None:
        inliers, others = probability.sum() - probability, np.full(count, count - 1.0)
    else:
        order = np.argsort(feature)
        half = int(np.ceil(np.sqrt(count)))
        total = np.concatenate([[0.0], np.cumsum(probability[order])])
        first, last = np.maximum(np.arange(count) - half, 0), np.minimum(np.arange(count) + half + 1, count)
        inliers, others = np.empty(count), np.empty(count)
        inliers[order], others[order] = total[last] - total[first], last - first - 1.0
        inliers -= probability
    return (others - inliers + PSEUDO_COUNT) / (others + 2 * PSEUDO_COUNT)


def _inlier_probability(residuals: Array, sigma: float, share: Array, outlier_density: float) -> Array:
    """Return the posterior probability (N,) of the Gaussian component."""
    exponent = np.nan_to_num(-0.5 * (residuals**2).sum(axis=1) / sigma**2, nan=-np.inf)
    inlier = (1 - share) * np.exp(exponent) / (np.sqrt(2 * np.pi) * sigma) ** residuals.shape[1]
    return inlier / (inlier + share * outlier_density)


def _normal_equations(residuals: Array, jacobian: Array, weights: Array) -> tuple[Array, Array]:
    """Return the gradient (P,) and J^T W J (P, P) of weighted residuals; rows of NaN count nothing."""
    use = np.isfinite(residuals).all(axis=1)
    j = jacobian[use].reshape(-1, jacobian.shape[2])
    weighted = j * np.repeat(weights[use], residuals.shape[1])[:, None]
    return weighted.T @ residuals[use].ravel(), weighted.T @ j
