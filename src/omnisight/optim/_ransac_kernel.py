"""Compiled LO-RANSAC for all problems of `_robust_problem_kernel`.

M. Fischler and R. Bolles, Random sample consensus, 1981. Truncated score: P. Torr and A. Zisserman, MLESAC, 2000. Local
optimization: O. Chum, J. Matas, J. Kittler, Locally optimized RANSAC, 2003. Sequential test: J. Matas and O. Chum,
Randomized RANSAC with sequential probability ratio test, 2005.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver, njit_helper
from omnisight.optim._cholesky_kernel import solve_symmetric
from omnisight.optim._normal_equations_kernel import add_observation
from omnisight.optim._robust_problem_kernel import linearize, retract, sizes, solve_minimal, squared_error

# The sequential test rejects a model as good as the best one with this probability.
REJECTION_PROBABILITY = 0.01
# Share of consistent observations under a wrong model, before any is measured, and its bounds.
INITIAL_CHANCE, MIN_CHANCE, MAX_CHANCE = 0.05, 1e-3, 0.5
# Share of inliers that the first sequential tests assume: smaller than in any problem that can be solved.
INITIAL_INLIER_SHARE = 0.1
# A minimal sample's model is optimized locally if no sample had a better one, or if it gains this fraction of what the
# best optimized model gains on no model. With 0.95, one of 150 planes in 60 degrees with 70 % outliers had a wrong
# pose.
PROMISING_GAIN = 0.8
# Samples drawn at least: with little parallax, the cost of a relative pose has several minima, and noise can make the
# optimum of one sample of a homography a bad one.
MIN_ITERATIONS = 50
# Local optimization: rounds of reweighting, the first with this many times the threshold (Lebeda, Matas, Chum 2012).
LOCAL_ROUNDS, LOCAL_WIDENING = 4, 4.0
# Observations of the rounds before the last one (Lebeda et al. limit them to 7 inliers per observation of a sample).
LOCAL_OBSERVATIONS = 150


@njit_driver
def estimate(problem, threshold, confidence, max_iterations, seed):
    """Estimate the model with the least truncated cost.

    Parameters
    ----------
    problem
        A problem, its rows in random order.
    threshold
        Squared error above which an observation is an outlier.
    confidence
        Probability of drawing at least one sample of inliers.
    max_iterations, seed
        Integers.

    Returns
    -------
    model, score, iterations
        (3, 4), its sum of squared errors truncated at the threshold, and the number of samples drawn. The score is that
        of outliers only if there is no model.
    """
    sample_size, solutions, _, _ = sizes(problem)
    count, sample, models = len(problem[0]), np.empty(sample_size, np.int64), np.empty((solutions, 3, 4))
    best, share = np.full((3, 4), np.nan), INITIAL_INLIER_SHARE
    best_score = best_of_samples = threshold * count
    tested, consistent = 1.0 / INITIAL_CHANCE, 1.0
    state, needed, iteration = np.uint64(seed), max_iterations, 0
    while iteration < needed:
        iteration += 1
        state = _draw(state, count, sample)
        for k in range(solve_minimal(problem, sample, models)):
            chance = min(max(consistent / tested, MIN_CHANCE), min(MAX_CHANCE, 0.8 * share))
            limit = max(best_of_samples, threshold * count - PROMISING_GAIN * (threshold * count - best_score))
            score, seen, hits = _score(problem, models[k], count, threshold, limit, share, chance)
            if score >= limit:
                tested += seen
                consistent += hits
                continue
            best_of_samples = min(score, best_of_samples)
            model, score = _locally_optimized(problem, models[k], count, threshold)
            if score >= best_score:
                continue
            best, best_score = model, score
            share = max(_inlier_share(problem, best, count, threshold), INITIAL_INLIER_SHARE)
            needed = min(max_iterations, max(MIN_ITERATIONS, samples_needed(share, sample_size, confidence)))
    return best, best_score, iteration


@njit_driver
def optimize_samples(problem, threshold, seed, optimized, scores):
    """Fill the locally optimized best models (M, 3, 4) of M samples, and their truncated costs; inf without a model."""
    sample_size, solutions, _, _ = sizes(problem)
    count, sample, models = len(problem[0]), np.empty(sample_size, np.int64), np.empty((solutions, 3, 4))
    state = np.uint64(seed)
    for m in range(len(scores)):
        state = _draw(state, count, sample)
        best, scores[m] = 0, np.inf
        for k in range(solve_minimal(problem, sample, models)):
            score = _truncated_cost(problem, models[k], count, threshold)
            if score < scores[m]:
                best, scores[m] = k, score
        if np.isfinite(scores[m]):
            model, scores[m] = _locally_optimized(problem, models[best], count, threshold)
            for i in range(3):
                for j in range(4):
                    optimized[m, i, j] = model[i, j]


@njit_helper
def _draw(state, count, sample):
    """Fill a sample with distinct indices; return the state of the random numbers (splitmix64: Steele et al. 2014)."""
    for k in range(len(sample)):
        is_new = False
        while not is_new:
            state = state + np.uint64(0x9E3779B97F4A7C15)
            z = state
            z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
            z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
            z = z ^ (z >> np.uint64(31))
            sample[k] = np.int64(z >> np.uint64(33)) % count
            is_new = True
            for j in range(k):
                is_new &= sample[j] != sample[k]
    return state


@njit_helper
def _score(problem, model, count, threshold, limit, share, chance):
    """Return the truncated cost, and how many observations were tested and consistent; inf if rejected early.

    A model is rejected if its cost reaches a limit, or by the sequential test of the inlier share against chance: an
    observation multiplies the likelihood ratio of a wrong to a good model by chance/share if it is consistent.
    """
    if_consistent, if_not = np.log(chance / share), np.log((1.0 - chance) / max(1.0 - share, 1e-9))
    largest, ratio, score, hits = -np.log(REJECTION_PROBABILITY), 0.0, 0.0, 0
    for i in range(count):
        error = squared_error(problem, model, i, i)
        if error < threshold:
            score += error
            ratio += if_consistent
            hits += 1
        else:
            score += threshold
            ratio += if_not
        if ratio > largest or score >= limit:
            return np.inf, i + 1, hits
    return score, count, hits


@njit_helper
def _locally_optimized(problem, model, count, threshold):
    """Return a model refined with a threshold that shrinks to the final one, and its truncated cost."""
    model, weights = model.copy(), np.empty(count)
    for k in range(LOCAL_ROUNDS):
        width = threshold * LOCAL_WIDENING ** (1.0 - k / (LOCAL_ROUNDS - 1.0))
        used = count if k == LOCAL_ROUNDS - 1 else min(count, LOCAL_OBSERVATIONS)
        for i in range(used):
            error = squared_error(problem, model, i, i)
            weights[i] = (1.0 - error / width) ** 2 if error < width else 0.0
        _refine(problem, model, weights, used)
    return model, _truncated_cost(problem, model, count, threshold)


@njit_helper
def _truncated_cost(problem, model, count, threshold):
    score = 0.0
    for i in range(count):
        score += min(squared_error(problem, model, i, i), threshold)
    return score


@njit_helper
def _refine(problem, model, weights, count):
    """Take a Gauss-Newton step on the weighted residuals of the first observations, in place."""
    _, _, dimension, parameters = sizes(problem)
    residual, jacobian = np.empty(dimension), np.empty((dimension, parameters))
    gradient, information = np.zeros(parameters), np.zeros((parameters, parameters))
    for i in range(count):
        if weights[i] > 0.0 and linearize(problem, model, i, residual, jacobian):
            add_observation(weights[i], residual, jacobian, gradient, information)
    retract(problem, model, solve_symmetric(information, -gradient))


@njit_helper
def _inlier_share(problem, model, count, threshold):
    inliers = 0
    for i in range(count):
        inliers += squared_error(problem, model, i, i) < threshold
    return inliers / count


@njit_helper
def samples_needed(share, sample_size, confidence):
    """Return how many samples contain one of inliers only, with the confidence."""
    clean = share**sample_size
    if clean >= 1.0:
        return 1
    return int(np.ceil(np.log(1.0 - confidence) / np.log1p(-clean)))
