"""Levenberg-Marquardt for small dense least-squares problems, one or many of equal size at a time."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from omnisight.optim.levenberg_marquardt import (
    DAMPING_GROWTH,
    INITIAL_DAMPING,
    MAX_DAMPING,
    MIN_DAMPING,
    Solution,
    blocked_by_bounds,
    damping_factor,
)

Array = NDArray[np.float64]
Bool = NDArray[np.bool_]
Index = NDArray[np.intp]
State = TypeVar("State")


class NormalEquations(NamedTuple):
    """Cost, gradient J^T r and Gauss-Newton Hessian J^T J of K problems with P parameters.

    Attributes
    ----------
    cost
        (K,) half the weighted sum of squares, or a robust cost; not finite where the state is impossible.
    gradient
        (K, P).
    hessian
        (K, P, P).
    """

    cost: Array
    gradient: Array
    hessian: Array

    @classmethod
    def of(cls, residuals: Array, jacobian: Array, weights: Array | None = None) -> Self:
        """Sum up residuals (K, N) with Jacobians (K, N, P) and weights (K, N).

        For a robust loss, pass its weights and replace `cost` by the robust cost (`_replace`).
        """
        with np.errstate(invalid="ignore", over="ignore"):
            weighted = residuals if weights is None else weights * residuals
            scaled = jacobian if weights is None else weights[..., None] * jacobian
            transposed = np.swapaxes(jacobian, -1, -2)
            gradient = (transposed @ weighted[..., None])[..., 0]
            # One problem as a matrix product: A^T A takes half the time of a general product.
            hessian = (transposed[0] @ scaled[0])[None] if len(jacobian) == 1 else transposed @ scaled
            return cls(0.5 * (residuals * weighted).sum(-1), gradient, hessian)

    def decrease(self, step: Array) -> Array:
        """Return the decrease (K,) of the quadratic model along steps (K, P)."""
        slope = self.gradient + 0.5 * (self.hessian @ step[..., None])[..., 0]
        return -(slope * step).sum(-1)

    def step(self, damping: Array) -> Array:
        """Return the steps (K, P) for a damping (K,) relative to the diagonal; NaN where the system is singular."""
        diagonal = np.diagonal(self.hessian, axis1=-2, axis2=-1)
        # A parameter without influence keeps its value.
        scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
        scaled = self.hessian * scale[..., :, None] * scale[..., None, :]
        index = np.arange(scale.shape[-1])
        scaled[..., index, index] += damping[:, None] + 1e-15
        return -scale * _solve(scaled, scale * self.gradient)

    def rows(self, rows: Any) -> "NormalEquations":
        """Return the normal equations of some of the problems."""
        return NormalEquations(self.cost[rows], self.gradient[rows], self.hessian[rows])

    def without(self, fixed: Bool) -> "NormalEquations":
        """Return the normal equations in which parameters (K, P) are fixed."""
        keep = ~fixed
        return self._replace(
            gradient=self.gradient * keep, hessian=self.hessian * (keep[..., :, None] & keep[..., None, :])
        )


@dataclass(frozen=True)
class DenseSolution(Solution[State]):
    """The solution of one dense problem.

    Attributes
    ----------
    hessian
        (P, P) J^T J at the solution; its inverse is the covariance for residuals of unit variance.
    """

    hessian: Array


@dataclass(frozen=True)
class BatchSolution(Generic[State]):
    """The solutions of K independent problems.

    Attributes
    ----------
    state
        As the start: an array (K, ...) or a tuple of such arrays.
    cost, converged, iterations
        (K,) each; iterations counts accepted steps.
    hessian
        (K, P, P) J^T J at the solution.
    """

    state: State
    cost: Array
    converged: Bool
    iterations: Index
    hessian: Array


def gauss_newton(
    linearize: Callable[[State], tuple[Array, Array] | NormalEquations],
    start: State,
    *,
    retract: Callable[[State, Array], State] | None = None,
    bounds: tuple[Array, Array] | None = None,
    max_iterations: int = 100,
    tolerance: float = 1e-12,
) -> DenseSolution[State]:
    """Minimize half the sum of squares of a small dense problem.

    Parameters
    ----------
    linearize
        state -> residuals (N,) and their Jacobian (N, P) by a step; not finite where the state is impossible.
        Or state -> `NormalEquations` with cost (), gradient (P,) and hessian (P, P), for weights and robust losses.
    start
        Initial state: a vector (P,), or anything that `retract` takes.
    retract
        state, step (P,) -> state; adds the step by default. Needed for rotations and poses.
    bounds
        Lower and upper bounds (P,) and (P,) of a vector state; equal bounds fix a parameter.
    max_iterations
        Maximum number of accepted steps.
    tolerance
        Stop when the expected decrease of the cost is below this fraction of it.
    """
    vector = isinstance(start, np.ndarray)

    def boxed(state: Any) -> Any:
        if vector:
            return np.asarray(state, float)[None]
        box = np.empty(1, object)
        box[0] = state
        return box

    def linearize_one(states: Any, _: Index) -> NormalEquations:
        made = linearize(states[0])
        if isinstance(made, NormalEquations):
            return NormalEquations(*(np.asarray(values, float)[None] for values in made))
        residuals, jacobian = made
        return NormalEquations.of(residuals[None], jacobian[None])

    def retract_one(states: Any, steps: Array) -> Any:
        return boxed(retract(states[0], steps[0]) if retract else states[0] + steps[0])

    batch = gauss_newton_batch(
        linearize_one,
        boxed(start),
        retract=retract_one,
        bounds=bounds,
        max_iterations=max_iterations,
        tolerance=tolerance,
    )
    cost, converged, iterations = float(batch.cost[0]), bool(batch.converged[0]), int(batch.iterations[0])
    if np.isfinite(cost):
        reason = "converged" if converged else f"not converged after {iterations} iterations"
    else:
        reason = "the cost of the initial state is not finite"
    return DenseSolution(batch.state[0], cost, converged, iterations, reason, batch.hessian[0])


def gauss_newton_batch(
    linearize: Callable[[Any, Index], NormalEquations],
    start: State,
    *,
    retract: Callable[[Any, Array], Any] | None = None,
    bounds: tuple[Array, Array] | None = None,
    max_iterations: int = 100,
    tolerance: float = 1e-12,
) -> BatchSolution[State]:
    """Minimize K independent dense problems of equal size together, each with its own damping.

    The method is that of `levenberg_marquardt.minimize`; problems that have converged are dropped.

    Parameters
    ----------
    linearize
        states (M, ...), problems (M,) -> their `NormalEquations`; problems are indices into the K problems.
    start
        Initial states: an array (K, ...), or a tuple of such arrays.
    retract
        states (M, ...), steps (M, P) -> states; adds the steps by default.
    bounds, max_iterations, tolerance
        As in `gauss_newton`.
    """
    state = _map(np.array, start)
    normal = linearize(state, np.arange(len(_arrays(state)[0])))
    normal = NormalEquations(*(np.array(values, float) for values in normal))
    normal.cost[~np.isfinite(normal.cost)] = np.inf
    count = len(normal.cost)
    damping, growth = np.full(count, INITIAL_DAMPING), np.full(count, DAMPING_GROWTH)
    iterations, converged = np.zeros(count, np.intp), np.zeros(count, np.bool_)
    active = np.flatnonzero(np.isfinite(normal.cost))
    while len(active):
        now, states = normal.rows(active), _map(lambda values, rows=active: values[rows], state)
        if bounds:
            now = now.without(blocked_by_bounds(states, now.gradient, *bounds))
        step = now.step(damping[active])
        predicted = now.decrease(step)
        if (stalled := predicted <= tolerance * now.cost).any():
            converged[active[stalled]] = True
            active = active[~stalled]
            continue
        # A singular system has no step: the damping grows.
        states = retract(states, np.nan_to_num(step, nan=0.0)) if retract else states + np.nan_to_num(step, nan=0.0)
        if bounds:
            states = np.clip(states, *bounds)
        new = linearize(states, active)
        with np.errstate(all="ignore"):
            fall = np.where(np.isfinite(new.cost), now.cost - new.cost, -np.inf)
            ratio = fall / predicted
            accepted = ratio > 0
            # The remaining decrease is about what the linearization missed plus what the damping withheld.
            remaining = np.minimum(np.abs(1 - ratio), 1.0) * fall
            near = np.flatnonzero(accepted & (remaining <= tolerance * new.cost))
            if len(near):
                last = now.rows(near)
                remaining[near] += np.abs(last.decrease(last.step(np.zeros(len(near)))) - predicted[near])
                converged[active[near]] = remaining[near] <= tolerance * new.cost[near]
        taken, rejected = active[accepted], active[~accepted]
        for values, others in zip((*_arrays(state), *normal), (*_arrays(states), *new), strict=True):
            values[taken] = others[accepted]
        iterations[taken] += 1
        damping[taken] = np.maximum(damping[taken] * damping_factor(ratio[accepted]), MIN_DAMPING)
        damping[rejected] *= growth[rejected]
        growth[rejected], growth[taken] = growth[rejected] * DAMPING_GROWTH, DAMPING_GROWTH
        converged[rejected] = damping[rejected] > MAX_DAMPING
        active = active[~converged[active] & (iterations[active] < max_iterations)]
    return BatchSolution(state, normal.cost, converged, iterations, normal.hessian)


def _arrays(state: Any) -> tuple[Any, ...]:
    return state if isinstance(state, tuple) else (state,)


def _map(function: Callable[[Any], Any], state: Any) -> Any:
    return tuple(map(function, state)) if isinstance(state, tuple) else function(state)


def _solve(matrices: Array, right: Array) -> Array:
    """Solve (K, P, P) systems; NaN for singular ones."""
    try:
        return np.asarray(np.linalg.solve(matrices, right[..., None])[..., 0], float)
    except np.linalg.LinAlgError:
        if len(matrices) == 1:
            return np.full_like(right, np.nan)
        return np.concatenate([_solve(a[None], b[None]) for a, b in zip(matrices, right, strict=True)])
