"""Compiled LO-RANSAC: one loop for all problems, whose methods numba resolves at compile time.

A problem is a `NamedTuple` of arrays with three static methods, written for compiled code:

- `solve_minimal(problem, sample, models) -> count` fills `models` (S, 3, 4) from the indices in `sample` (K,);
- `squared_error(problem, model, i) -> float` is the squared residual of observation i over its variance;
- `refined(problem, model, weights) -> model` takes Gauss-Newton steps with weights (N,), and changes its argument.

M. Fischler and R. Bolles, Random sample consensus, 1981. Truncated score: P. Torr and A. Zisserman, MLESAC, 2000. Local
optimization: O. Chum, J. Matas, J. Kittler, Locally optimized RANSAC, 2003. Sequential test: J. Matas and O. Chum,
Randomized RANSAC with sequential probability ratio test, 2005.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

import inspect

import numpy as np
from numba.extending import overload

from omnisight.compiled import NJIT_OPTIONS, njit_driver, njit_helper

# The sequential test rejects a model as good as the best one with this probability.
REJECTION_PROBABILITY = 0.01
# Share of consistent observations under a wrong model, before any is measured, and its bounds.
INITIAL_CHANCE, MIN_CHANCE, MAX_CHANCE = 0.05, 1e-3, 0.5
# Share of inliers that the first sequential tests assume: smaller than in any problem that can be solved.
INITIAL_INLIER_SHARE = 0.1
# A minimal sample's model is optimized locally if no sample had a better one, or if it gains this fraction of what the
# best optimized model gains on no model.
PROMISING_GAIN = 0.95
# Samples drawn at least: with little parallax, the cost has several minima.
MIN_ITERATIONS = 50
# Local optimization: rounds of reweighting, the first with this many times the threshold (Lebeda, Matas, Chum 2012).
LOCAL_ROUNDS, LOCAL_WIDENING = 4, 4.0


def solve_minimal(problem, sample, models):
    """Return the number of models that a minimal sample determines; defined by the problem."""
    raise NotImplementedError


def squared_error(problem, model, i):
    """Return the squared residual of one observation over its variance; defined by the problem."""
    raise NotImplementedError


def refined(problem, model, weights):
    """Return a model after Gauss-Newton steps with weights; defined by the problem."""
    raise NotImplementedError


def _defined_by_the_problem(method):
    def resolve(problem, *_):
        return getattr(problem.instance_class, method.__name__)

    resolve.__signature__ = inspect.signature(method)
    overload(method, jit_options=NJIT_OPTIONS)(resolve)


for _method in (solve_minimal, squared_error, refined):
    _defined_by_the_problem(_method)


@njit_driver
def estimate(problem, sample, models, threshold, confidence, max_iterations, seed):
    """Estimate the model with the least truncated cost.

    Parameters
    ----------
    problem
        A problem, see above. Its first field has one row per observation, and the rows are in random order.
    sample
        (K,) integers, where K is the size of a minimal sample; overwritten.
    models
        (S, 3, 4), where S is the largest number of models of a sample; overwritten.
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
    count = len(problem[0])
    best, share = np.full(models.shape[1:], np.nan), INITIAL_INLIER_SHARE
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
            best[:], best_score = model, score
            share = max(_inlier_share(problem, best, count, threshold), INITIAL_INLIER_SHARE)
            needed = min(max_iterations, max(MIN_ITERATIONS, _samples_needed(share, len(sample), confidence)))
    return best, best_score, iteration


@njit_driver
def squared_errors(problem, model):
    """Return the squared residuals (N,) of all observations over their variances."""
    squares = np.empty(len(problem[0]))
    for i in range(len(squares)):
        squares[i] = squared_error(problem, model, i)
    return squares


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
        error = squared_error(problem, model, i)
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
        for i in range(count):
            error = squared_error(problem, model, i)
            weights[i] = (1.0 - error / width) ** 2 if error < width else 0.0
        model = refined(problem, model, weights)
    score = 0.0
    for i in range(count):
        score += min(squared_error(problem, model, i), threshold)
    return model, score


@njit_helper
def _inlier_share(problem, model, count, threshold):
    inliers = 0
    for i in range(count):
        inliers += squared_error(problem, model, i) < threshold
    return inliers / count


@njit_helper
def _samples_needed(share, sample_size, confidence):
    """Return how many samples contain one of inliers only, with the confidence."""
    clean = share**sample_size
    if clean >= 1.0:
        return 1
    return int(np.ceil(np.log(1.0 - confidence) / np.log1p(-clean)))
