"""How well the corners tell a camera's parameters."""

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.candidates import Candidate
from omnisight.calibrate.freedom import Freedom
from omnisight.calibrate.refine import Bundle
from omnisight.calibrate.spread import Spread
from omnisight.calibrate.views import BoardViews

Array = NDArray[np.float64]


def camera_covariance(candidate: Candidate, views: BoardViews, *, loss: str = "huber") -> Array:
    """Give the covariance (P, P) of the camera's parameters; zero for those that stood still.

    The inverse of the normal equations, the poses and the bend of the board eliminated: whatever they take up is
    uncertain in the camera. Residuals have the spread that they show, each pose and parameter having taken its part of
    it (Triggs et al. 2000, sec. 9).
    """
    state, freedom = candidate.state, candidate.freedom
    spread = Spread.of(state, views, loss)
    normal = Bundle(views, freedom, spread).linearise(state)
    count = freedom.directions.shape[1]
    among = normal.shared_covariance()[:count, :count]
    return residual_variance(spread, views, freedom) * freedom.directions @ among @ freedom.directions.T


def residual_variance(spread: Spread, views: BoardViews, freedom: Freedom) -> float:
    """Give the variance, px^2, of a corner's coordinate: that of the residuals, and what was fitted of it."""
    measured = views.pixels.size
    left = measured - freedom.count - 6 * len(views)
    return spread.sigma**2 * measured / max(left, 1)
