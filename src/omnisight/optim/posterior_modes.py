"""Which local optimum of a robust estimation is the most probable model, and how probable it is."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.optim.refinement import THRESHOLDS, Refinement, refine

Array = NDArray[np.float64]

# Inliers above which a model has no rival: among 500 bearings of relative poses with 35 inliers, other local optima
# were e^5 to e^80 times less probable, with 70 inliers e^13 times at least.
MAX_INLIERS = 100
# Samples from which local optima are searched, and how many of the best ones are refined.
SAMPLES, MAX_REFINED = 200, 20
# Squared distance of two models over the covariance above which they are different; it is exceeded once in 1e5 by a
# chi-squared variable of five degrees of freedom.
MIN_SQUARED_DISTANCE = 30.0
# Step for derivatives of models by differences.
STEP = 1e-6


def most_probable(problem: Any, fit: Refinement, seed: int) -> tuple[Refinement, float]:
    """Return the most probable model near a local optimum of the cost, and its probability against the second one.

    Few observations leave several local optima, whose probabilities are proportional to their likelihoods.

    Parameters
    ----------
    problem
        A problem of `_robust_problem_kernel` with the true noise, its observations in random order.
    fit
        The model found by the search, with the noise of the problem.
    seed
        Seed of the random numbers.
    """
    if fit.is_inlier.sum() > MAX_INLIERS:
        return fit, 1.0
    fits = [fit, *(refine(problem, model) for model in _local_optima(problem, seed))]
    best = max(fits, key=lambda each: each.evidence)
    rivals = [each for each in fits if _squared_distance(problem, best, each) > MIN_SQUARED_DISTANCE]
    if not rivals:
        return best, 1.0
    gain = best.evidence - max(each.evidence for each in rivals)
    return best, float(1 / (1 + np.exp(-gain)))


def _local_optima(problem: Any, seed: int) -> Array:
    """Return models (M, 3, 4) of least truncated cost, each optimized from one sample."""
    from omnisight.optim._ransac_kernel import optimize_samples

    models, scores = np.empty((SAMPLES, 3, 4)), np.empty(SAMPLES)
    optimize_samples(problem, THRESHOLDS[problem.sizes(problem)[2]], seed, models, scores)
    order = np.argsort(scores, kind="stable")[:MAX_REFINED]
    return models[order[np.isfinite(scores[order])]]


def _squared_distance(problem: Any, a: Refinement, b: Refinement) -> float:
    """Return the squared length of the step from a model to another one over the covariance of the first."""
    from omnisight.optim._robust_problem_kernel import moved

    steps = STEP * np.eye(len(a.covariance))
    columns = [(moved(problem, a.model, step) - moved(problem, a.model, -step)).ravel() / (2 * STEP) for step in steps]
    step = np.linalg.lstsq(np.column_stack(columns), (b.model - a.model).ravel(), rcond=None)[0]
    return float(step @ np.linalg.solve(a.covariance, step))
