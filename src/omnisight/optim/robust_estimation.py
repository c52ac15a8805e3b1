"""Robust maximum-likelihood estimation: the same steps for every geometric model with outliers."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.optim.false_alarms import chance_probability, log_false_alarms
from omnisight.optim.ransac import RansacOptions, permuted, ransac

Array = NDArray[np.float64]

# Squared length of a residual over its variance that 99.7 % of the inliers do not exceed (3 sigma in one dimension), by
# the dimension of the residual.
THRESHOLDS = {1: 9.0, 2: 11.83}
# The search is repeated with the estimated noise if that is below this fraction of the assumed one, at most so often.
MAX_NOISE_RATIO, MAX_SEARCHES = 0.5, 4
# Correspondences beyond a minimal sample that are needed to tell inliers from outliers.
MIN_REDUNDANCY = 3
# Expected number of models that fit as many unrelated correspondences by chance above which a model is rejected.
MAX_FALSE_ALARMS = 1e-3


@dataclass(frozen=True, eq=False)
class RobustEstimate:
    """The result of a robust estimation.

    Attributes
    ----------
    model
        (3, 4), or None with a reason.
    covariance
        (P, P) covariance of a step of the model.
    inliers
        (N,), whether each correspondence is more probably an inlier than an outlier.
    scale
        Standard deviation of the residuals in units of the assumed ones.
    score
        Sum of the squared residuals of the search, truncated at the threshold.
    iterations
        Number of samples drawn.
    reason
        Why there is no model; empty otherwise.
    """

    model: Array | None
    covariance: Array
    inliers: NDArray[np.bool_]
    scale: float = float("nan")
    score: float = float("nan")
    iterations: int = 0
    reason: str = ""


def estimate_robustly(
    problem_of_scale: Callable[[float], Any], *, is_scale_known: bool, options: RansacOptions
) -> RobustEstimate:
    """Estimate a model from correspondences with outliers.

    LO-RANSAC finds the model; it is refined to the maximum likelihood under a mixture of Gaussian noise and outliers,
    whose density near zero is measured on unrelated correspondences. If the noise is unknown, the search is repeated
    while it is much smaller than assumed. A model that unrelated correspondences fit as well is rejected.

    Parameters
    ----------
    problem_of_scale
        Factor of the assumed standard deviations -> problem of `_robust_problem_kernel`.
    is_scale_known
        Whether the factor is 1.
    options
        Options of the search.
    """
    from omnisight.optim._mixture_kernel import fit_mixture

    problem = problem_of_scale(1.0)
    count, (sample_size, _, dimension, parameters) = len(problem[0]), problem.sizes(problem)
    if count < sample_size + MIN_REDUNDANCY:
        return _failure(count, f"{count} correspondences, at least {sample_size + MIN_REDUNDANCY} are needed")
    order = np.random.default_rng(options.seed).permutation(count)
    scale, iterations, searches = 1.0, 0, 0
    while True:
        problem = permuted(problem_of_scale(scale), order)
        found = ransac(problem, THRESHOLDS[dimension], options)
        iterations, searches = iterations + found.iterations, searches + 1
        if not np.isfinite(found.model).all():
            return _failure(count, "no model is consistent with a sample of the correspondences", iterations)
        density = outlier_density(problem, found.model)
        fit = fit_mixture(problem, found.model, density, is_scale_known, np.zeros((parameters, parameters)))
        model, probability, factor, information, _ = fit
        scale *= factor
        if factor > MAX_NOISE_RATIO or searches == MAX_SEARCHES:
            break
    is_inlier = np.asarray(probability > 0.5)
    reason = _chance_reason(permuted(problem_of_scale(scale), order), model, is_inlier)
    inliers = np.empty_like(is_inlier)
    inliers[order] = is_inlier
    covariance = np.asarray(np.linalg.pinv(information, hermitian=True), float)
    return RobustEstimate(None if reason else model, covariance, inliers, scale, found.score, iterations, reason)


def outlier_density(problem: Any, model: Array) -> float:
    """Return the density near zero of the residuals of unrelated correspondences, over their standard deviations."""
    dimension = problem.sizes(problem)[2]
    threshold = THRESHOLDS[dimension]
    volume = 2 * np.sqrt(threshold) if dimension == 1 else np.pi * threshold
    return chance_probability(problem, model, threshold) / float(volume)


def _chance_reason(problem: Any, model: Array, is_inlier: NDArray[np.bool_]) -> str:
    """Return why a model is rejected, if unrelated correspondences would fit one as well; empty otherwise."""
    from omnisight.optim._robust_problem_kernel import squared_errors

    squares = squared_errors(problem, model)
    count, inliers = len(squares), int(is_inlier.sum())
    threshold = float(squares[is_inlier & np.isfinite(squares)].max(initial=0.0))
    sample_size, solutions, _, _ = problem.sizes(problem)
    probability = chance_probability(problem, model, threshold)
    if log_false_alarms(count, inliers, probability, sample_size, solutions) <= np.log(MAX_FALSE_ALARMS):
        return ""
    return f"{inliers} of {count} correspondences agree, as unrelated ones do by chance"


def _failure(count: int, reason: str, iterations: int = 0) -> RobustEstimate:
    nothing = np.zeros(count, np.bool_)
    return RobustEstimate(None, np.full((0, 0), np.nan), nothing, iterations=iterations, reason=reason)
