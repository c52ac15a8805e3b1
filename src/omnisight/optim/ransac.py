"""Robust estimation from observations with outliers: LO-RANSAC (compiled, `_ransac_kernel`)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.choices import Options

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RansacOptions(Options):
    """Options of the random search.

    Attributes
    ----------
    confidence
        Probability of drawing at least one sample without outliers, if the best model so far has all inliers. A wrong
        model has few and does not end the search: with 0.9 and 0.99, relative poses of 100 pairs of each of 70 scenes
        were equally accurate. Where structures repeat, it may have as many: of images that show mostly a checkerboard,
        8 of 21 relative poses are wrong with 0.9, and 5 of 19 with 0.99.
    max_iterations
        Largest number of samples. 20,000 samples of five contain one of inliers only, with 99 % probability, if 19 % of
        the observations are inliers.
    seed
        Seed of the random numbers: the same input and seed give the same result.
    """

    confidence: float = 0.99
    max_iterations: int = 20_000
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the numbers."""
        super().__post_init__()
        if not 0 < self.confidence < 1:
            raise ValueError(f"confidence must be between 0 and 1, got {self.confidence}")
        if self.max_iterations < 1:
            raise ValueError(f"max_iterations must be at least 1, got {self.max_iterations}")
        if self.seed < 0:
            raise ValueError(f"seed must be 0 or more, got {self.seed}")


@dataclass(frozen=True)
class RansacResult:
    """The model with the least truncated cost.

    Attributes
    ----------
    model
        (3, 4), as the problem defines it; NaN if no sample had a model.
    score
        Sum of the squared errors, each truncated at the threshold.
    iterations
        Number of samples drawn.
    """

    model: Array
    score: float
    iterations: int


def ransac(problem: Any, threshold: float, options: RansacOptions) -> RansacResult:
    """Estimate a model from observations with outliers.

    Parameters
    ----------
    problem
        A problem of `_robust_problem_kernel`, its observations, at least those of one sample, in random order.
    threshold
        Squared error, in units of its variance, above which an observation is an outlier.
    options
        Options of the search.
    """
    from omnisight.optim._ransac_kernel import estimate

    search = options.confidence, options.max_iterations, options.seed
    model, score, iterations = estimate(problem, float(threshold), *search)
    return RansacResult(model, float(score), int(iterations))


def permuted(problem: Any, order: NDArray[np.intp]) -> Any:
    """Return a problem with its observations in an order (N,)."""
    return type(problem)(*(rows.take(order, axis=0) for rows in problem))  # a tenth of the time of rows[order]
