"""Robust maximum-likelihood estimation: the same steps for every geometric model with outliers."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.optim.false_alarms import chance_probability, log_false_alarms
from omnisight.optim.posterior_modes import most_probable
from omnisight.optim.ransac import RansacOptions, permuted, ransac
from omnisight.optim.refinement import THRESHOLDS, Refinement, refine

Array = NDArray[np.float64]

# The search is repeated with the estimated noise if that is below this fraction of the assumed one, at most so often.
MAX_NOISE_RATIO, MAX_SEARCHES = 0.5, 4
# Correspondences beyond a minimal sample that are needed to distinguish inliers from outliers.
MIN_REDUNDANCY = 3
# Expected number of models that fit as many unrelated correspondences by chance above which a model is rejected.
MAX_FALSE_ALARMS = 1e-3
# Observations with a larger squared error over its variance disagree with a model, whatever the noise.
MIN_DISAGREEMENT = 25.0
# One-sided quantile of a Gaussian of the level 1e-5: a model has more support than another if the difference of two
# Poisson counts of its size occurs less often by chance.
MAX_CHANCE_GAIN = 4.26
# Probability of a model below which it is ambiguous.
MIN_PROBABILITY = 0.99
# Probability that the search for another model finds one with which 39 % of the other observations agree, with samples
# of five.
ALTERNATIVE_CONFIDENCE, MAX_ALTERNATIVE_ITERATIONS = 0.99, 500


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
    order
        (N,) indices of the correspondences in the random order of the search.
    scale
        Standard deviation of the residuals in units of the assumed ones.
    score
        Sum of the squared residuals of the search, truncated at the threshold.
    iterations
        Number of samples drawn.
    reason
        Why there is no model; empty otherwise.
    has_alternative_model
        Whether the reason is another model with nearly as much support.
    probability
        Of the model against the most probable other one, see `most_probable`.
    """

    model: Array | None
    covariance: Array
    inliers: NDArray[np.bool_]
    order: NDArray[np.intp]
    scale: float = float("nan")
    score: float = float("nan")
    iterations: int = 0
    reason: str = ""
    has_alternative_model: bool = False
    probability: float = 1.0

    @property
    def ambiguity(self) -> str:
        """Why the model is ambiguous, if another one is nearly as probable; empty otherwise."""
        if self.probability >= MIN_PROBABILITY:
            return ""
        other = f"another model is {1 - self.probability:.0%} probable"
        return f"too few correspondences agree ({self.inliers.sum()}): {other}"


def estimate_robustly(
    problem_of_scale: Callable[[float], Any], *, is_scale_known: bool, options: RansacOptions
) -> RobustEstimate:
    """Estimate a model from correspondences with outliers.

    LO-RANSAC finds the model; it is refined to the maximum likelihood under a mixture of Gaussian noise and outliers,
    whose density near zero is measured on unrelated correspondences. If the noise is unknown, the search is repeated
    while it is much smaller than assumed. A model that unrelated correspondences fit as well is rejected, and so is one
    if nearly as many of the other correspondences agree with an alternative model.

    Parameters
    ----------
    problem_of_scale
        Factor of the assumed standard deviations -> problem of `_robust_problem_kernel`.
    is_scale_known
        Whether the factor is 1.
    options
        Options of the search.
    """
    from omnisight.optim._mixture_kernel import MIN_SCALE

    problem = problem_of_scale(1.0)
    count, (sample_size, _, dimension, _) = len(problem[0]), problem.sizes(problem)
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
        fit = refine(problem, found.model, is_scale_known=is_scale_known)
        scale = max(scale * fit.scale, MIN_SCALE)
        if fit.scale > MAX_NOISE_RATIO or scale == MIN_SCALE or searches == MAX_SEARCHES:
            break
    if not is_scale_known:
        problem = permuted(problem_of_scale(scale), order)
    probability, alternative, chance = 1.0, "", _chance_reason(problem, fit)
    if not chance:
        fit, probability = most_probable(problem, fit, options.seed)
        alternative = _alternative_reason(problem, fit.model, options)
    inliers = np.empty_like(fit.is_inlier)
    inliers[order] = fit.is_inlier
    model, reason = None if chance or alternative else fit.model, chance or alternative
    search = found.score, iterations, reason, bool(alternative)
    return RobustEstimate(model, fit.covariance, inliers, order, scale, *search, probability)


def _chance_reason(problem: Any, fit: Refinement) -> str:
    """Return why a model is rejected, if unrelated correspondences would fit one as well; empty otherwise."""
    from omnisight.optim._robust_problem_kernel import squared_errors

    squares = squared_errors(problem, fit.model)
    count, inliers = len(squares), int(fit.is_inlier.sum())
    threshold = float(squares[fit.is_inlier & np.isfinite(squares)].max(initial=0.0))
    sample_size, solutions, _, _ = problem.sizes(problem)
    probability = chance_probability(problem, fit.model, threshold)
    if log_false_alarms(count, inliers, probability, sample_size, solutions) <= np.log(MAX_FALSE_ALARMS):
        return ""
    return f"{inliers} of {count} correspondences agree, as unrelated ones do by chance"


def _alternative_reason(problem: Any, model: Array, options: RansacOptions) -> str:
    """Return why a model is rejected, if another one has nearly as much support among the others; empty otherwise.

    Matches of repeated structures, such as the squares of a checkerboard, agree with many wrong models. The best one is
    then no better than the second, and the support of the second measures what chance provides.
    """
    from omnisight.optim._ransac_kernel import samples_needed
    from omnisight.optim._robust_problem_kernel import squared_errors

    sample_size, _, dimension, _ = problem.sizes(problem)
    threshold = THRESHOLDS[dimension]
    squares = squared_errors(problem, model)
    support, others = int((squares <= threshold).sum()), permuted(problem, np.flatnonzero(squares > MIN_DISAGREEMENT))
    least = sample_size + _least_support(max(support - sample_size, 0))
    if len(others[0]) < least:
        return ""
    needed = samples_needed.py_func(least / len(others[0]), sample_size, ALTERNATIVE_CONFIDENCE)
    search = replace(options, max_iterations=min(needed, MAX_ALTERNATIVE_ITERATIONS))
    alternative = ransac(others, threshold, search).model
    agreeing = int((squared_errors(others, alternative) <= threshold).sum())
    if agreeing < least:
        return ""
    return f"{support} correspondences agree with one model, {agreeing} with another: structures repeat or move"


def _least_support(support: int) -> float:
    """Return the least n that is not significantly smaller than a support: support - n <= gain sqrt(support + n).

    Both are counted beyond a minimal sample, which any model agrees with.
    """
    square = MAX_CHANCE_GAIN**2
    return max(support + square / 2 - float(np.sqrt(square * (2 * support + square / 4))), 1.0)


def _failure(count: int, reason: str, iterations: int = 0) -> RobustEstimate:
    nothing, order = np.zeros(count, np.bool_), np.arange(count)
    return RobustEstimate(None, np.full((0, 0), np.nan), nothing, order, iterations=iterations, reason=reason)
