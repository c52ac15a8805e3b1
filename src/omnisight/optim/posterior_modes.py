"""Which local optimum of a robust estimation is the most probable model, and how probable it is."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.optim.refinement import THRESHOLDS, Refinement, refine

Array = NDArray[np.float64]

# Inliers above which no other model is searched for. The next local optimum of relative poses in 60 degrees with 35
# inliers was up to e^17 times more probable than the one found; that of real pairs of fisheye images with 69 to 79
# inliers e^13 times less probable, or more.
MAX_INLIERS = 100
# Samples from which local optima are searched, and how many of the best different ones are refined.
SAMPLES, MAX_REFINED = 200, 20
# Squared distance of two models over the covariance above which they are different; it is exceeded once in 1e5 by a
# chi-squared variable of five degrees of freedom.
MIN_SQUARED_DISTANCE = 30.0
# Step for derivatives of models by differences, and relative difference of models that are equal but for rounding.
STEP, ROUNDING = 1e-6, 1e-12


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
    others = _local_optima(problem, seed)
    others = others[_squared_distances(problem, fit, others) > MIN_SQUARED_DISTANCE]
    fits = [fit, *(refine(problem, model) for model in others[:MAX_REFINED])]
    best = max(fits, key=lambda each: each.evidence)
    distances = _squared_distances(problem, best, np.array([each.model for each in fits]))
    others = [each.evidence for each, d in zip(fits, distances, strict=True) if d > MIN_SQUARED_DISTANCE]
    return best, float(1 / (1 + np.exp(max(others, default=-np.inf) - best.evidence)))


def _local_optima(problem: Any, seed: int) -> Array:
    """Return models (M, 3, 4), each optimized from one sample, in the order of their truncated costs."""
    from omnisight.optim._ransac_kernel import optimize_samples

    models, scores = np.empty((SAMPLES, 3, 4)), np.empty(SAMPLES)
    optimize_samples(problem, THRESHOLDS[problem.sizes(problem)[2]], seed, models, scores)
    order = np.argsort(scores, kind="stable")
    return models[order[np.isfinite(scores[order])]]


def _squared_distances(problem: Any, fit: Refinement, models: Array) -> Array:
    """Return the squared lengths (M,) of the steps from a model to others (M, 3, 4) over its covariance."""
    from omnisight.optim._robust_problem_kernel import moved

    changes = [
        moved(problem, fit.model, step) - moved(problem, fit.model, -step)
        for step in STEP * np.eye(len(fit.covariance))
    ]
    slopes = np.reshape(changes, (-1, 12)).T / (2 * STEP)
    differences = (models - fit.model).reshape(-1, 12)
    differences[np.abs(differences).max(axis=1) < ROUNDING * np.abs(fit.model).max()] = 0.0
    steps = differences @ np.linalg.pinv(slopes).T
    return (steps * np.linalg.solve(fit.covariance, steps.T).T).sum(axis=1)
