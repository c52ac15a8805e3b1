"""Whether an estimate could be due to chance: the expected number of false alarms."""

from collections.abc import Callable
from math import lgamma, log

import numpy as np
from numpy.typing import NDArray

# Unrelated correspondences from which the probability of a chance inlier is measured: rounds with all of them until so
# many were tested, but at most so many rounds.
UNRELATED, MAX_ROUNDS = 2000, 20


def chance_probability(count: int, is_consistent: Callable[[int], NDArray[np.bool_]]) -> float:
    """Return the probability that an unrelated correspondence is consistent with a model.

    Parameters
    ----------
    count
        Number N of correspondences.
    is_consistent
        shift -> (N,), whether the first part of each correspondence is consistent with the second part of the one that
        many rows further.
    """
    rounds = min(MAX_ROUNDS, count - 1, 1 + UNRELATED // count)
    shifts = [1 + i * (count - 1) // rounds for i in range(rounds)]
    hits = sum(int(is_consistent(shift).sum()) for shift in shifts)
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
