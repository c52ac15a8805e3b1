"""How far corners lie from where a camera puts them, and what that makes each of them count."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.state import State
from omnisight.calibrate.views import BoardViews
from omnisight.optim.loss import robust_sigma

Array = NDArray[np.float64]

HUBER_SIGMAS = 5.0
# What corners are off by in any case, px: a covariance of zero must not outweigh all others.
LEAST_SPREAD = 1e-4


@dataclass(frozen=True)
class Spread:
    """The spread of the residuals at a state.

    Attributes
    ----------
    roots
        (N, 2, 2) what residuals are multiplied with to make them alike: then all have the same spread, in px.
    sigma
        Robust standard deviation of a coordinate of the residuals so weighted, px.
    threshold
        Length, px, of a weighted residual past which a corner counts as doubtful.
    """

    roots: Array
    sigma: float
    threshold: float

    @classmethod
    def of(cls, state: State, views: BoardViews, loss: str = "huber") -> Self:
        """Estimate it; with the loss "squared" every corner counts the same, however far off.

        Raises
        ------
        ValueError
            If there is no such loss.
        """
        if loss not in ("huber", "squared"):
            raise ValueError(f"loss must be 'huber' or 'squared', got {loss!r}")
        equal = loss == "squared" or not views.covariance.any()
        roots = np.tile(np.eye(2), (len(views.pixels), 1, 1)) if equal else _roots(state, views)
        sigma = robust_sigma(state.lengths(views, roots))
        return cls(roots, sigma, np.inf if loss == "squared" else max(HUBER_SIGMAS * sigma, 1e-6))

    def part(self, rows: NDArray[np.intp]) -> Self:
        """Give it for some of the corners."""
        return replace(self, roots=self.roots[rows])

    def like(self, other: Self) -> bool:
        """Say whether the two are as good as the same."""
        return abs(self.sigma - other.sigma) <= 0.02 * other.sigma

    def doubtful(self, state: State, views: BoardViews) -> NDArray[np.bool_]:
        """Say which corners (N,) are farther off than corners are."""
        return state.lengths(views, self.roots) > self.threshold


def _roots(state: State, views: BoardViews) -> Array:
    """Give matrices (N, 2, 2) that make residuals alike.

    A residual's covariance is the corner's own C plus t^2 I, what model, print and light add to every corner alike.
    t is such that the median of r^T (C + t^2 I)^-1 r is that of two normal variables, 2 ln 2.
    """
    own = np.trace(views.covariance, axis1=1, axis2=2) / 2
    # Alone a corner would ask for t^2 = |r|^2/(2 ln 2) - C: half of them ask for more than the median of these.
    shared = max(float(np.median(state.lengths(views) ** 2 / (2 * np.log(2)) - own)), LEAST_SPREAD**2)
    covariance = views.covariance + shared * np.eye(2)
    scale = np.median(own) + shared
    return np.swapaxes(np.linalg.cholesky(np.linalg.inv(covariance) * scale), 1, 2).copy()
