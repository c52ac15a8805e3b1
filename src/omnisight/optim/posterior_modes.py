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
# Largest error of the linearized change of the residuals between local optima of one solution, relative to the change.
# It was 0.001 to 0.003 between those of 4 images of a phone in maps of a rendered room and street, which share 90 % of
# their inliers, at least 10 between both poses of a distant plane, and mostly above 0.2 between relative poses of few
# pairs. Of 960 synthetic sets of 20 to 100 pairs, 848 instead of 834 have a pose with it, and as many wrong ones (15).
MAX_NONLINEARITY = 0.1
# Step for derivatives of models by differences, and relative difference of models that are equal but for rounding.
STEP, ROUNDING = 1e-6, 1e-12


def most_probable(problem: Any, fit: Refinement, seed: int) -> tuple[Refinement, float]:
    """Return the most probable model near a local optimum of the cost, and its probability against a rival.

    Few observations leave several local optima, whose probabilities are proportional to their likelihoods. If the
    residuals change linearly between an optimum and the most probable one, both are one solution with other outliers:
    the covariance of the model then contains the step between them. The other optima are rivals.

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
    others = others[_squared_distances(fit, _steps(problem, fit, others)) > MIN_SQUARED_DISTANCE]
    # An optimum that no more observations agree with than a sample has is that of outliers only: its covariance, and so
    # its evidence, is unbounded.
    optima = (refine(problem, model) for model in others[:MAX_REFINED])
    optima = (each for each in optima if each.is_inlier.sum() > problem.sizes(problem)[0])
    fits = sorted([fit, *optima], key=lambda each: -each.evidence)
    best = fits[0]
    steps = _steps(problem, best, np.array([each.model for each in fits]))
    neighbours, rivals = [0], list[int]()
    for k in np.flatnonzero(_squared_distances(best, steps) > MIN_SQUARED_DISTANCE).tolist():
        if _nonlinearity(problem, best, steps[k], fits[k].model) > MAX_NONLINEARITY:
            rivals.append(k)
        # Several searches end in the same optimum, which counts once.
        elif _squared_distances(best, steps[k] - steps[neighbours]).min() > MIN_SQUARED_DISTANCE:
            neighbours.append(k)
    weights = np.exp([fits[k].evidence - best.evidence for k in neighbours])
    covariance = best.covariance + (steps[neighbours].T * weights / weights.sum()) @ steps[neighbours]
    rival = max((fits[k].evidence for k in rivals), default=-np.inf)
    return best._replace(covariance=covariance), float(1 / (1 + np.exp(rival - best.evidence)))


def _local_optima(problem: Any, seed: int) -> Array:
    """Return models (M, 3, 4), each optimized from one sample, in the order of their truncated costs."""
    from omnisight.optim._ransac_kernel import optimize_samples

    models, scores = np.empty((SAMPLES, 3, 4)), np.empty(SAMPLES)
    optimize_samples(problem, THRESHOLDS[problem.sizes(problem)[2]], seed, models, scores)
    order = np.argsort(scores, kind="stable")
    return models[order[np.isfinite(scores[order])]]


def _steps(problem: Any, fit: Refinement, models: Array) -> Array:
    """Return the steps (M, P) from a model to others (M, 3, 4), to first order."""
    from omnisight.optim._robust_problem_kernel import moved

    changes = [
        moved(problem, fit.model, step) - moved(problem, fit.model, -step)
        for step in STEP * np.eye(len(fit.covariance))
    ]
    slopes = np.reshape(changes, (-1, 12)).T / (2 * STEP)
    differences = (models - fit.model).reshape(-1, 12)
    differences[np.abs(differences).max(axis=1) < ROUNDING * np.abs(fit.model).max()] = 0.0
    return differences @ np.linalg.pinv(slopes).T


def _squared_distances(fit: Refinement, steps: Array) -> Array:
    """Return the squared lengths (M,) of steps (M, P) over the covariance of a model."""
    return (steps * np.linalg.solve(fit.covariance, steps.T).T).sum(axis=1)


def _nonlinearity(problem: Any, fit: Refinement, step: Array, model: Array) -> float:
    """Return the error of the linearized change of the residuals of inliers, relative to their change to a model."""
    from omnisight.optim._robust_problem_kernel import linearized

    before, jacobians = linearized(problem, fit.model)
    after, _ = linearized(problem, model)
    use = fit.is_inlier & np.isfinite(before[:, 0])
    change = (after - before)[use]
    if not np.isfinite(change).all():  # impossible at the other model
        return np.inf
    return float(np.linalg.norm(jacobians[use] @ step - change) / max(float(np.linalg.norm(change)), 1e-300))
