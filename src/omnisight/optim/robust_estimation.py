"""Robust maximum-likelihood estimation: the same steps for every geometric model with outliers."""

from dataclasses import dataclass, replace
from typing import Any, Generic, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from omnisight.optim.false_alarms import chance_probability, log_false_alarms
from omnisight.optim.mixture import Mixture, fit_mixture
from omnisight.optim.ransac import RansacOptions, RansacResult, ransac

Array = NDArray[np.float64]
State = TypeVar("State")

# Squared length of a residual over its variance that 99.7 % of the inliers do not exceed (3 sigma in one dimension), by
# the dimension of the residual.
THRESHOLDS = {1: 9.0, 2: 11.83}
# The search is repeated with the estimated noise if that is below this fraction of the assumed one, at most so often.
MAX_NOISE_RATIO, MAX_SEARCHES = 0.5, 4
# Expected number of models that fit as many unrelated correspondences by chance above which a model is rejected.
MAX_FALSE_ALARMS = 1e-3


class RobustProblem(Protocol[State]):
    """Correspondences and the model that they determine."""

    @property
    def sample_size(self) -> int:
        """Size of a minimal sample."""
        ...

    @property
    def max_solutions(self) -> int:
        """Largest number of models of a sample."""
        ...

    @property
    def dimension(self) -> int:
        """Dimension D of a residual."""
        ...

    @property
    def is_noise_known(self) -> bool:
        """False if the covariances hold only up to a common factor, which is to be estimated."""
        ...

    def __len__(self) -> int:
        """Return the number of correspondences."""
        ...

    def compiled(self, order: NDArray[np.intp]) -> Any:
        """Return the problem for `ransac`, its correspondences in an order (N,)."""
        ...

    def scaled(self, factor: float) -> Self:
        """Return the problem with standard deviations multiplied by a factor."""
        ...

    def unrelated(self, shift: int) -> Self:
        """Return the problem with the second part of the correspondence so many rows away."""
        ...

    def state(self, model: Array) -> State:
        """Return the state of a model that the search has found."""
        ...

    def linearize(self, state: State) -> tuple[Array, Array]:
        """Return the residuals (N, D) over their standard deviations, NaN if impossible, and Jacobians (N, D, P)."""
        ...

    def feature(self, state: State) -> Array | None:
        """Return a quantity (N,) on which the share of outliers depends; None if it is the same for all."""
        ...

    def retract(self, state: State, step: Array) -> State:
        """Return the state after a step (P,)."""
        ...


@dataclass(frozen=True, eq=False)
class RobustEstimate(Generic[State]):
    """The result of a robust estimation.

    Attributes
    ----------
    state
        The state, or None with a reason.
    covariance
        (P, P) covariance of a step of the state.
    inliers
        (N,), whether each correspondence is more probably an inlier than an outlier.
    scale
        Standard deviation of the residuals in units of the assumed ones.
    score
        Sum of the squared residuals of the search, truncated at the threshold.
    iterations
        Number of samples drawn.
    reason
        Why there is no state; empty otherwise.
    """

    state: State | None
    covariance: Array
    inliers: NDArray[np.bool_]
    scale: float = float("nan")
    score: float = float("nan")
    iterations: int = 0
    reason: str = ""


def estimate_robustly(problem: RobustProblem[State], options: RansacOptions) -> RobustEstimate[State]:
    """Estimate a model from correspondences with outliers.

    LO-RANSAC finds the model; it is refined to the maximum likelihood under a mixture of Gaussian noise and outliers,
    whose density near zero is measured on unrelated correspondences. If the noise is unknown, the search is repeated
    while it is much smaller than assumed. A model that unrelated correspondences fit as well is rejected.
    """
    minimum = problem.sample_size + 3
    if len(problem) < minimum:
        return _failure(problem, f"{len(problem)} correspondences, at least {minimum} are needed")
    return _estimate(problem, options, MAX_SEARCHES)


def _estimate(problem: RobustProblem[State], options: RansacOptions, searches: int) -> RobustEstimate[State]:
    """Estimate a model in at most so many searches."""
    found = _search(problem, options)
    if not np.isfinite(found.model).all():
        return _failure(problem, "no model is consistent with a sample of the correspondences", found.iterations)
    fit = refine(problem, problem.state(found.model))
    problem = problem.scaled(fit.scale)
    if fit.scale <= MAX_NOISE_RATIO and searches > 1:
        again = _estimate(problem, options, searches - 1)
        return replace(again, scale=again.scale * fit.scale, iterations=again.iterations + found.iterations)
    inliers = fit.probability > 0.5
    state, reason = fit.state, ""
    if _log_false_alarms(problem, fit.state, inliers) > np.log(MAX_FALSE_ALARMS):
        state = None
        reason = f"{inliers.sum()} of {len(problem)} correspondences agree, as unrelated ones do by chance"
    return RobustEstimate(state, fit.covariance, inliers, fit.scale, found.score, found.iterations, reason)


def refine(problem: RobustProblem[State], start: State) -> Mixture[State]:
    """Compute the maximum likelihood near a state, and the scale of the noise unless it is known."""
    return fit_mixture(
        problem.linearize,
        start,
        retract=problem.retract,
        outlier_density=_outlier_density(problem, start),
        scale=1.0 if problem.is_noise_known else None,
        feature=problem.feature,
    )


def _search(problem: RobustProblem[State], options: RansacOptions) -> RansacResult:
    order = np.random.default_rng(options.seed).permutation(len(problem))
    sizes = problem.sample_size, problem.max_solutions
    return ransac(problem.compiled(order), *sizes, THRESHOLDS[problem.dimension], options)


def _outlier_density(problem: RobustProblem[State], state: State) -> float:
    """Return the density of residuals of unrelated correspondences near zero."""
    threshold = THRESHOLDS[problem.dimension]
    volume = 2 * np.sqrt(threshold) if problem.dimension == 1 else np.pi * threshold
    return _probability(problem, state, threshold) / float(volume)


def _probability(problem: RobustProblem[State], state: State, threshold: float) -> float:
    return chance_probability(
        len(problem), lambda shift: _squares(problem.unrelated(shift).linearize(state)[0]) <= threshold
    )


def _log_false_alarms(problem: RobustProblem[State], state: State, inliers: NDArray[np.bool_]) -> float:
    squares = _squares(problem.linearize(state)[0])
    threshold = float(squares[inliers & np.isfinite(squares)].max(initial=0.0))
    probability = _probability(problem, state, threshold)
    sizes = problem.sample_size, problem.max_solutions
    return log_false_alarms(len(problem), int(inliers.sum()), probability, *sizes)


def _squares(residuals: Array) -> Array:
    return np.nan_to_num((residuals**2).sum(axis=1), nan=np.inf)


def _failure(problem: RobustProblem[State], reason: str, iterations: int = 0) -> RobustEstimate[State]:
    nothing = np.zeros(len(problem), np.bool_)
    return RobustEstimate(None, np.full((0, 0), np.nan), nothing, iterations=iterations, reason=reason)
