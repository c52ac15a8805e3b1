"""Weights of the residuals: whitening by corner covariances, robust standard deviation and Huber threshold."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.estimation_options import Loss
from omnisight.calibration.state import State, identity_whitening, residual_lengths
from omnisight.display import Displayed
from omnisight.optim.loss import RAYLEIGH_MEDIAN, robust_sigma
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# Huber threshold in standard deviations per coordinate: of Gaussian residuals, 4e-6 are longer.
OUTLIER_SIGMA = 5.0
# Standard deviation (px) that every corner has at least: a covariance of zero must not outweigh all others.
MIN_SIGMA_PX = 1e-4
# Threshold (px) at which exact, noise-free corners still count as inliers.
MIN_THRESHOLD_PX = 1e-6
# Relative change of sigma below which the weights have converged.
SIGMA_TOLERANCE = 0.02
# Relative size of a product below which a difference of products is rounding.
ROUNDING = 1e-12


@dataclass(frozen=True)
class ResidualWeights(Displayed):
    """Weights of the residuals, estimated at a state.

    Attributes
    ----------
    whitening
        (N, 2, 2) matrices that give all residuals the same covariance, in px.
    sigma
        Robust standard deviation of a coordinate of the whitened residuals, px.
    threshold
        Length of a whitened residual (px) above which a corner is an outlier.
    """

    whitening: Array
    sigma: float
    threshold: float

    @classmethod
    def estimate(cls, state: State, observations: Observations, loss: Loss = "huber") -> Self:
        """Estimate the weights from the residuals at a state; the loss "squared" weighs all corners alike."""
        residuals = state.residuals(observations)
        if loss == "squared" or not observations.covariance.any():
            whitening = identity_whitening(len(residuals))
        else:
            whitening = _whitening(residual_lengths(residuals, observations), observations.covariance)
        sigma = robust_sigma(residual_lengths(residuals, observations, whitening))
        threshold = np.inf if loss == "squared" else max(OUTLIER_SIGMA * sigma, MIN_THRESHOLD_PX)
        return cls(whitening, sigma, threshold)

    def subset(self, rows: NDArray[np.intp]) -> Self:
        """Return the weights of some of the corners."""
        return replace(self, whitening=self.whitening[rows])

    def is_close(self, other: Self) -> bool:
        """Return whether two estimates agree up to `SIGMA_TOLERANCE`."""
        return abs(self.sigma - other.sigma) <= SIGMA_TOLERANCE * other.sigma

    def outliers(self, state: State, observations: Observations) -> NDArray[np.bool_]:
        """Return which corners (N,) have whitened residuals longer than the threshold."""
        return state.lengths(observations, self.whitening) > self.threshold


def _whitening(lengths: Array, covariance: Array) -> Array:
    """Return whitening matrices (N, 2, 2) from residual lengths and the corners' own covariances.

    A residual's covariance is the corner's own C plus t^2 I, where t is the error that model, print and light add to
    every corner alike. t is such that the median of r^T (C + t^2 I)^-1 r is that of two normal variables, 2 ln 2.
    """
    a, b, d = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    middle = 0.5 * (a + d)
    # A corner alone gives t^2 = |r|^2/(2 ln 2) - C; the median over the corners is robust.
    shared = max(float(np.median((lengths / RAYLEIGH_MEDIAN) ** 2 - middle)), MIN_SIGMA_PX**2)
    a, d = a + shared, d + shared
    scale = np.median(middle) + shared
    # U of scale C^-1 = U^T U, upper triangular. The determinant of a corner uncertain along a line may round to < 0.
    over, side = np.sqrt(scale / d), np.sqrt(np.maximum(a * d - b * b, ROUNDING * a * d))
    whitening = np.zeros((len(covariance), 2, 2))
    whitening[:, 0, 0], whitening[:, 0, 1], whitening[:, 1, 1] = over * d / side, -over * b / side, over
    return whitening
