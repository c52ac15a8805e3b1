"""Robust losses: the cost of a residual length, and the weight for iteratively reweighted least squares."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Median length of a 2-vector of independent unit Gaussians (Rayleigh distribution).
RAYLEIGH_MEDIAN = np.sqrt(2 * np.log(2))


@dataclass(frozen=True)
class Huber:
    """Quadratic up to `threshold`, linear beyond; an infinite threshold is least squares (Huber 1964)."""

    threshold: float = np.inf

    def cost(self, length: Array) -> float:
        """Return half the sum of the losses."""
        return float(self.costs(length).sum())

    def costs(self, length: Array) -> Array:
        """Return half the loss of each residual."""
        inside = np.minimum(length, self.threshold)
        return inside * (length - 0.5 * inside)

    def weight(self, length: Array) -> Array:
        """Return the weight of each residual in the normal equations."""
        return np.where(length > self.threshold, self.threshold / np.maximum(length, 1e-300), 1.0)


def robust_sigma(length: Array) -> float:
    """Return the standard deviation per coordinate of 2-D residuals, from the median of their lengths."""
    return float(np.median(length) / RAYLEIGH_MEDIAN) if len(length) else 0.0


@dataclass(frozen=True)
class Cauchy:
    """The loss c² log(1 + s/c²) of a squared length s, with the threshold c: long residuals hardly have influence."""

    threshold: float

    def cost(self, squares: Array) -> float:
        """Return half the sum of the losses; an infinite residual costs as much as one of a hundred thresholds."""
        square = self.threshold**2
        return float(0.5 * square * np.log1p(np.minimum(squares / square, 1e4)).sum())

    def weight(self, squares: Array) -> Array:
        """Return the weight of each residual in the normal equations."""
        return np.where(np.isfinite(squares), 1.0 / (1.0 + squares / self.threshold**2), 0.0)
