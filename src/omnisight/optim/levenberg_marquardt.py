"""Levenberg-Marquardt for any problem that provides its own normal equations."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
State = TypeVar("State")

# Differences of a cost below this fraction of it are mostly rounding.
ROUNDING = 1e-6
# Damping relative to the diagonal of the normal equations: at the start, at least, and where no step helps any more.
INITIAL_DAMPING, MIN_DAMPING, MAX_DAMPING = 1e-6, 1e-15, 1e14
# Factor of the damping after a rejected step; doubles with every further rejection.
DAMPING_GROWTH = 2.0
# Decrease of the cost over the predicted one above which a longer step is tried, and its largest factor. Outliers that
# pull in all directions make the normal equations of robust costs too stiff, most of all along drifts.
LONG_STEP_RATIO, MAX_STEP_FACTOR = 1.5, 10.0


class Linearized(Protocol):
    """The normal equations of a least-squares problem at one state, in any sparse form."""

    def solve(self, damping: float) -> Array:
        """Return the step that minimizes the linearized cost with the diagonal scaled by 1 + damping."""
        ...

    def decrease(self, step: Array) -> float:
        """Return the decrease of the linearized cost along a step (undamped)."""
        ...


class Problem(Protocol[State]):
    """A least-squares problem over states that steps of a vector space move."""

    def cost(self, state: State) -> float:
        """Return half the (robust) sum of squares; inf where the state is impossible."""
        ...

    def linearize(self, state: State) -> Linearized:
        """Return the normal equations at the state."""
        ...

    def move(self, state: State, step: Array) -> State:
        """Return the state moved by a step, within its bounds."""
        ...


@dataclass(frozen=True)
class Solution(Generic[State]):
    """The result of a minimization.

    Attributes
    ----------
    state
        The best state.
    cost
        Half the (robust) sum of squares there.
    converged
        Whether the cost stopped decreasing; False if the iterations ran out.
    iterations
        Number of linearizations.
    reason
        Why the minimization stopped.
    """

    state: State
    cost: float
    converged: bool
    iterations: int
    reason: str


def minimize(
    problem: Problem[State],
    start: State,
    *,
    iterations: int = 100,
    tolerance: float = 1e-9,
    scale: float = np.inf,
    damping: float = INITIAL_DAMPING,
    first: Linearized | None = None,
    watch: Callable[[int, float], None] | None = None,
) -> Solution[State]:
    """Minimize by Levenberg-Marquardt with Nielsen's damping (Madsen, Nielsen and Tingleff 2004, algorithm 3.16).

    A step that decreases the cost far more than predicted is extended to the minimum of a parabola.

    Parameters
    ----------
    problem
        Costs, linearizations and moves.
    start
        Initial state; its cost must be finite.
    iterations
        Maximum number of linearizations.
    tolerance
        Stop when the expected decrease of the cost is below this fraction of it.
    scale
        Reference cost for `tolerance` if it is smaller than the cost: outliers can make up nearly all of a cost.
    damping
        Initial damping, relative to the diagonal of the normal equations.
    first
        The normal equations at the start, if known.
    watch
        Called with the iteration and the cost.
    """
    state, cost, growth = start, problem.cost(start), DAMPING_GROWTH
    if not np.isfinite(cost):
        return Solution(state, cost, False, 0, "the cost of the initial state is not finite")
    for iteration in range(1, iterations + 1):
        linearized = problem.linearize(state) if iteration > 1 or first is None else first
        had_step = False
        while True:
            step = linearized.solve(damping)
            predicted = linearized.decrease(step) if np.all(np.isfinite(step)) else np.nan
            if predicted <= tolerance * _reference_cost(cost, scale):
                return Solution(state, cost, True, iteration, "no step decreases the cost")
            finite = np.isfinite(predicted)
            had_step |= bool(finite)
            moved = problem.move(state, step) if finite else state
            new_cost = problem.cost(moved) if finite else np.inf
            ratio = (cost - new_cost) / predicted
            if ratio > LONG_STEP_RATIO:
                # The minimum of the parabola through both costs with the slope of the first one.
                longer = problem.move(state, min(1 / max(2 - ratio, 1e-9), MAX_STEP_FACTOR) * step)
                moved, new_cost = min((moved, new_cost), (longer, problem.cost(longer)), key=lambda each: each[1])
            if ratio > 0:
                break
            damping, growth = damping * growth, growth * DAMPING_GROWTH
            if damping > MAX_DAMPING:
                reason = "no step decreases the cost" if had_step else "the normal equations have no finite solution"
                return Solution(state, cost, had_step, iteration, reason)
        damping = max(damping * float(damping_factor(ratio)), MIN_DAMPING)
        growth = DAMPING_GROWTH
        fall = cost - new_cost
        state, cost = moved, new_cost
        if watch:
            watch(iteration, cost)
        # The remaining decrease is about what the linearization missed plus what the damping withheld.
        missed = min(abs(1 - ratio), 1.0) * fall
        threshold = tolerance * _reference_cost(cost, scale)
        if missed <= threshold and missed + _withheld(linearized, predicted) <= threshold:
            return Solution(state, cost, True, iteration, "the cost stopped decreasing")
    return Solution(state, cost, False, iterations, f"not converged after {iterations} iterations")


def blocked_by_bounds(state: Array, gradient: Array, low: Array, high: Array) -> NDArray[np.bool_]:
    """Return which parameters cannot move: they lie on a bound that the descent direction crosses."""
    return ((state <= low) & (gradient > 0)) | ((state >= high) & (gradient < 0)) | (low == high)


def damping_factor(ratio: ArrayLike) -> Array:
    """Return Nielsen's factor of the damping after a step that decreased the cost by `ratio` times the prediction."""
    return np.maximum(1 / 3, 1 - (2 * np.asarray(ratio, float) - 1) ** 3)


def _withheld(linearized: Linearized, predicted: float) -> float:
    """Return the decrease that the damping withheld from a step."""
    with np.errstate(over="ignore", invalid="ignore"):  # steps along unobservable directions
        return abs(linearized.decrease(linearized.solve(0.0)) - predicted)


def _reference_cost(cost: float, scale: float) -> float:
    return max(min(cost, scale), ROUNDING * cost)
