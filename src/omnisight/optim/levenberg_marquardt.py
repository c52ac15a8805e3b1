"""Levenberg-Marquardt, for any problem that can linearise itself."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
State = TypeVar("State")

# Share of a cost below which differences are hardly more than rounding.
ROUNDING = 1e-6


class Linearised(Protocol):
    """The normal equations of a least-squares problem at one state, in whatever sparse form suits it."""

    def solve(self, damping: float) -> Array:
        """Give the step that minimises the linearised cost, the diagonal scaled up by 1 + damping."""
        ...

    def decrease(self, step: Array) -> float:
        """Give by how much the linearised cost falls along the step (undamped)."""
        ...


class Problem(Protocol[State]):
    """A least-squares problem over states that are moved by steps of a vector space."""

    def cost(self, state: State) -> float:
        """Give half the (robust) sum of squares; inf where the state is not possible."""
        ...

    def linearise(self, state: State) -> Linearised:
        """Give the normal equations at the state."""
        ...

    def move(self, state: State, step: Array) -> State:
        """Give the state moved by a step, kept inside its bounds."""
        ...


@dataclass(frozen=True)
class Solution(Generic[State]):
    """What a minimisation found.

    Attributes
    ----------
    state
        The best state met.
    cost
        Half the (robust) sum of squares there.
    converged
        Whether the cost stopped falling; false if the steps ran out.
    iterations
        Steps begun.
    reason
        Why it stopped, in words.
    """

    state: State
    cost: float
    converged: bool
    iterations: int
    reason: str


def minimise(
    problem: Problem[State],
    start: State,
    *,
    iterations: int = 100,
    tolerance: float = 1e-9,
    scale: float = np.inf,
    damping: float = 1e-6,
    first: Linearised | None = None,
    watch: Callable[[int, float], None] | None = None,
) -> Solution[State]:
    """Minimise by Levenberg-Marquardt with Nielsen's damping (Madsen, Nielsen and Tingleff 2004, algorithm 3.16).

    Parameters
    ----------
    problem
        Costs, linearisations and moves.
    start
        Where to begin; its cost must be finite.
    iterations
        The most linearisations.
    tolerance
        Stop when the cost is predicted to fall by less than this share of it.
    scale
        Or of this, where it is less: wrong measurements can be nearly all of a cost.
    damping
        The first damping, relative to the diagonal of the normal equations.
    first
        The normal equations at the start, if they are known.
    watch
        Called with the iteration and the cost.
    """
    state, cost, growth = start, problem.cost(start), 2.0
    if not np.isfinite(cost):
        return Solution(state, cost, False, 0, "the start is not possible")
    for iteration in range(1, iterations + 1):
        linearised = problem.linearise(state) if iteration > 1 or first is None else first
        while True:
            step = linearised.solve(damping)
            predicted = linearised.decrease(step) if np.all(np.isfinite(step)) else np.nan
            if predicted <= tolerance * _least(cost, scale):
                return Solution(state, cost, True, iteration, "no step lowers the cost")
            possible = np.isfinite(predicted)
            moved = problem.move(state, step) if possible else state
            new_cost = problem.cost(moved) if possible else np.inf
            gained = (cost - new_cost) / predicted
            if gained > 0:
                break
            damping, growth = damping * growth, growth * 2
            if damping > 1e14:
                return Solution(state, cost, True, iteration, "no step lowers the cost")
        damping = max(damping * max(1 / 3, 1 - (2 * gained - 1) ** 3), 1e-15)
        growth = 2.0
        fall = cost - new_cost
        state, cost = moved, new_cost
        if watch:
            watch(iteration, cost)
        # What is still to be gained is about what the linearisation missed of this step, and what damping withheld.
        missed = min(abs(1 - gained), 1.0) * fall
        settled = tolerance * _least(cost, scale)
        if missed <= settled and missed + _withheld(linearised, predicted) <= settled:
            return Solution(state, cost, True, iteration, "the cost stopped falling")
    return Solution(state, cost, False, iterations, f"{iterations} iterations were not enough")


def _withheld(linearised: Linearised, predicted: float) -> float:
    """Give what damping kept a step from gaining."""
    with np.errstate(over="ignore", invalid="ignore"):  # of a step along what nothing tells
        return abs(linearised.decrease(linearised.solve(0.0)) - predicted)


def _least(cost: float, scale: float) -> float:
    return max(min(cost, scale), ROUNDING * cost)
