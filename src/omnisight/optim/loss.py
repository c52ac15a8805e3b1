"""Robust losses: the cost of a residual length, and the weight for iteratively reweighted least squares."""

from dataclasses import dataclass
from math import lgamma
from typing import Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Median of the absolute value of a unit Gaussian, and of the length of a 2-vector of two (Rayleigh distribution).
NORMAL_MEDIAN = 0.67448975
RAYLEIGH_MEDIAN = float(np.sqrt(2 * np.log(2)))
# Degrees of freedom among which those of residuals are selected, and rounds for the scale of each.
DEGREES_OF_FREEDOM = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 10.0, 20.0, 50.0, 1e9)
SCALE_ROUNDS = 20
# Square of a residual over that of the scale, beyond which the cost is constant.
MAX_SQUARE = 1e4


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


def geman_mcclure_weights(squares: Array, scale2: Array | float) -> Array:
    """Return the weights (1 + r^2/c^2)^-2, from 0 to 1, of squared residuals r^2 with the squared scale c^2.

    They are those of the loss c^2 r^2 / (c^2 + r^2) / 2 (S. Geman, D. McClure, Statistical methods for tomographic
    image reconstruction, 1987).
    """
    return 1 / (1 + squares / scale2) ** 2


def robust_sigma(length: Array) -> float:
    """Return the standard deviation per coordinate of 2-D residuals, from the median of their lengths."""
    return float(np.median(length) / RAYLEIGH_MEDIAN) if len(length) else 0.0


@dataclass(frozen=True)
class StudentT:
    """The negative log-likelihood of residuals in two dimensions with the heavy tails of Student's t distribution.

    K. Lange, R. Little, J. Taylor, Robust statistical modeling using the t distribution, 1989. Without tails (infinite
    degrees of freedom) it is half the sum of squares over the variance.

    Attributes
    ----------
    degrees
        Degrees of freedom; fewer have heavier tails.
    sigma
        Scale of the residuals: their standard deviation if there are no tails.
    """

    degrees: float = 1e9
    sigma: float = 1.0

    @classmethod
    def fit(cls, squares: Array, dimensions: Array | float = 2.0, shares: Array | float = 1.0) -> Self:
        """Estimate the distribution of residuals by maximum likelihood.

        Parameters
        ----------
        squares
            (N,) squared lengths; infinite ones are left out.
        dimensions
            (N,) 1 or 2.
        shares
            (N,) weights of the residuals: those of dependent ones are below 1.
        """
        squares, dimensions, shares = np.broadcast_arrays(squares, dimensions, shares)
        use = np.isfinite(squares) & (shares > 0)
        squares, dimensions, shares = squares[use], dimensions[use], shares[use]
        if not squares.any():
            return cls()
        fitted = [cls(degrees, _scale(squares, dimensions, shares, degrees)) for degrees in DEGREES_OF_FREEDOM]
        return min(fitted, key=lambda loss: loss._negative_log_likelihood(squares, dimensions, shares))

    def _negative_log_likelihood(self, squares: Array, dimensions: Array, shares: Array) -> float:
        """Return the negative log-likelihood of residuals of one or two dimensions, up to a constant."""
        normalized = np.log1p(squares / (self.degrees * self.sigma**2))
        of_line = lgamma((self.degrees + 1) / 2) - lgamma(self.degrees / 2) - 0.5 * np.log(self.degrees / 2)
        each = 0.5 * (self.degrees + dimensions) * normalized + dimensions * np.log(self.sigma)
        return float((shares * (each - of_line * (dimensions == 1))).sum())

    def cost(self, squares: Array) -> float:
        """Return the cost of squared lengths (N,); an infinite one costs as much as a hundred times the scale."""
        normalized = np.minimum(squares / self.sigma**2, MAX_SQUARE) / self.degrees
        return float(0.5 * (self.degrees + 2) * np.log1p(normalized).sum())

    def weight(self, squares: Array) -> Array:
        """Return the weights (N,) in the normal equations; zero of an infinite length."""
        return (self.degrees + 2) / (self.degrees * self.sigma**2 + squares)

    @property
    def information(self) -> float:
        """Expected information of a residual along each axis: the inverse of the variance of a mean, per residual."""
        return (self.degrees + 2) / ((self.degrees + 4) * self.sigma**2)


def _scale(squares: Array, dimensions: Array, shares: Array, degrees: float) -> float:
    """Return the scale of maximum likelihood for given degrees of freedom, by expectation maximization."""
    square, total = float(np.median(squares / dimensions)), float((shares * dimensions).sum())
    for _ in range(SCALE_ROUNDS):
        weights = shares * (degrees + dimensions) / (degrees + squares / max(square, 1e-300))
        square = float((weights * squares).sum()) / total
    return float(np.sqrt(square))
