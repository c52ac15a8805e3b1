"""Small least-squares problems with a dense Jacobian."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.optim.levenberg_marquardt import Array, Solution, minimise

Residuals = Callable[[Array], Array]
Derivatives = Callable[[Array], tuple[Array, Array]]


@dataclass(frozen=True)
class DenseNormal:
    """The normal equations H x = -g of r(x) with a dense Jacobian."""

    hessian: Array
    gradient: Array

    def solve(self, damping: float) -> Array:
        """Give the damped step."""
        diagonal = np.diagonal(self.hessian)
        # A parameter that nothing depends on stays where it is.
        floor = np.where(diagonal > 0, diagonal, 1.0)
        scale = 1 / np.sqrt(floor)
        scaled = self.hessian * scale[:, None] * scale
        scaled[np.diag_indices_from(scaled)] += damping + 1e-15
        try:
            return -scale * np.linalg.solve(scaled, scale * self.gradient)
        except np.linalg.LinAlgError:
            return np.full_like(self.gradient, np.nan)

    def decrease(self, step: Array) -> float:
        """Give the predicted fall of the cost."""
        return float(-self.gradient @ step - 0.5 * step @ self.hessian @ step)


@dataclass(frozen=True)
class DenseProblem:
    """Half the sum of squares of r(x) (N,), x kept between bounds; `derivatives` gives r and its Jacobian (N, P)."""

    residuals: Residuals
    derivatives: Derivatives
    low: Array
    high: Array
    free: NDArray[np.bool_]

    def cost(self, state: Array) -> float:
        r = self.residuals(state)
        return float(0.5 * r @ r) if np.all(np.isfinite(r)) else np.inf

    def linearise(self, state: Array) -> DenseNormal:
        r, jacobian = self.derivatives(state)
        # What lies on a bound and is drawn past it stays there: the others find their own best.
        held = held_back(state, jacobian.T @ r, self.low, self.high)
        jacobian = np.where(held, 0.0, jacobian)[:, self.free]
        return DenseNormal(jacobian.T @ jacobian, jacobian.T @ r)

    def move(self, state: Array, step: Array) -> Array:
        moved = state.copy()
        moved[self.free] += step
        return np.clip(moved, self.low, self.high)


def held_back(state: Array, gradient: Array, low: Array, high: Array) -> NDArray[np.bool_]:
    """Say which parameters lie on a bound and are drawn past it."""
    return ((state <= low) & (gradient > 0)) | ((state >= high) & (gradient < 0))


def least_squares(
    residuals: Residuals,
    derivatives: Derivatives,
    start: Array,
    *,
    low: Array | float = -np.inf,
    high: Array | float = np.inf,
    free: NDArray[np.bool_] | None = None,
    iterations: int = 100,
    tolerance: float = 1e-12,
) -> Solution[Array]:
    """Minimise half the sum of squares of a small problem.

    Parameters
    ----------
    residuals
        x (P,) -> residuals (N,); not finite where x is not possible.
    derivatives
        x (P,) -> residuals (N,) and their Jacobian (N, P).
    start
        Where to begin, (P,).
    low, high
        Bounds.
    free
        Which parameters move (P,); all unless told otherwise.
    """
    size = start.shape
    problem = DenseProblem(
        residuals,
        derivatives,
        np.broadcast_to(np.asarray(low, float), size),
        np.broadcast_to(np.asarray(high, float), size),
        np.ones(size, np.bool_) if free is None else free,
    )
    return minimise(problem, start, iterations=iterations, tolerance=tolerance)
