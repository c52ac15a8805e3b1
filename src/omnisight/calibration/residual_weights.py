"""How far corners lie from where a camera puts them, and what that makes each of them count."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.state import State, identity_weights, lengths
from omnisight.optim.loss import robust_sigma
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

HUBER_SIGMAS = 5.0
# What corners are off by in any case, px: a covariance of zero must not outweigh all others.
MIN_SIGMA_PX = 1e-4
# Share of a product that is only rounding.
ROUNDED = 1e-12


@dataclass(frozen=True)
class ResidualWeights:
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
    def of(cls, state: State, views: Observations, loss: str = "huber") -> Self:
        """Estimate it; with the loss "squared" every corner counts the same, however far off.

        Raises
        ------
        ValueError
            If there is no such loss.
        """
        if loss not in ("huber", "squared"):
            raise ValueError(f"loss must be 'huber' or 'squared', got {loss!r}")
        residuals = state.residuals(views)
        equal = loss == "squared" or not views.covariance.any()
        roots = identity_weights(len(residuals)) if equal else _roots(lengths(residuals, views), views.covariance)
        sigma = robust_sigma(lengths(residuals, views, roots))
        return cls(roots, sigma, np.inf if loss == "squared" else max(HUBER_SIGMAS * sigma, 1e-6))

    def part(self, rows: NDArray[np.intp]) -> Self:
        """Give it for some of the corners."""
        return replace(self, roots=self.roots[rows])

    def like(self, other: Self) -> bool:
        """Say whether the two are as good as the same."""
        return abs(self.sigma - other.sigma) <= 0.02 * other.sigma

    def doubtful(self, state: State, views: Observations) -> NDArray[np.bool_]:
        """Say which corners (N,) are farther off than corners are."""
        return state.lengths(views, self.roots) > self.threshold


def _roots(away: Array, own: Array) -> Array:
    """Give matrices (N, 2, 2) that make residuals alike, from their lengths and the corners' covariances.

    A residual's covariance is the corner's own C plus t^2 I, what model, print and light add to every corner alike.
    t is such that the median of r^T (C + t^2 I)^-1 r is that of two normal variables, 2 ln 2.
    """
    a, b, d = own[:, 0, 0], own[:, 0, 1], own[:, 1, 1]
    middle = 0.5 * (a + d)
    # Alone a corner would ask for t^2 = |r|^2/(2 ln 2) - C: half of them ask for more than the median of these.
    shared = max(float(np.median(away**2 / (2 * np.log(2)) - middle)), MIN_SIGMA_PX**2)
    a, d = a + shared, d + shared
    scale = np.median(middle) + shared
    # U of scale C^-1 = U^T U, upper triangular. A doubt along one line alone may be rounded to below 0 across it.
    over, side = np.sqrt(scale / d), np.sqrt(np.maximum(a * d - b * b, ROUNDED * a * d))
    roots = np.zeros((len(own), 2, 2))
    roots[:, 0, 0], roots[:, 0, 1], roots[:, 1, 1] = over * d / side, -over * b / side, over
    return roots
