"""Whether an estimate could be due to chance: the expected number of false alarms."""

from math import lgamma, log
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Unrelated correspondences from which the probability of a chance inlier is measured: rounds with all of them until so
# many were tested, but at most so many rounds.
UNRELATED, MAX_ROUNDS = 2000, 20


def chance_probability(problem: Any, model: Array, threshold: float) -> float:
    """Return the probability that the parts of two different correspondences agree with a model.

    Parameters
    ----------
    problem
        A problem of `_robust_problem_kernel`, its observations in random order.
    model
        (3, 4).
    threshold
        Largest squared error of parts that agree.
    """
    from omnisight.optim._robust_problem_kernel import count_consistent

    count = len(problem[0])
    rounds = min(MAX_ROUNDS, count - 1, 1 + UNRELATED // count)
    shifts = 1 + np.arange(rounds) * (count - 1) // rounds
    hits = count_consistent(problem, model, threshold, shifts)
    return (hits + 1) / (count * len(shifts) + 1)


def log_false_alarms(count: int, inliers: int, probability: float, sample_size: int, solutions: int) -> float:
    """Return the logarithm of the expected number of models that fit as many of N unrelated correspondences by chance.

    With k inliers, samples of s with up to m models and the probability p that an unrelated correspondence is
    consistent, it is m (N - s) C(N, k) C(k, s) p^(k - s) (L. Moisan and B. Stival, A probabilistic criterion to detect
    rigid point matches between two images, IJCV 2004).
    """
    if inliers <= sample_size:
        return float("inf")
    choices = _log_choose(count, inliers) + _log_choose(inliers, sample_size)
    return log(solutions * (count - sample_size)) + choices + (inliers - sample_size) * log(probability)


def _log_choose(n: int, k: int) -> float:
    return lgamma(n + 1) - lgamma(k + 1) - lgamma(n - k + 1)
