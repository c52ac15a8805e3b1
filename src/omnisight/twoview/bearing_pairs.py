"""Pairs of bearings of two cameras, with their covariances."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# Standard deviation of a bearing, degrees, with which the noise is estimated if it is not given: above that of matched
# features, which is about a pixel, of every camera that sees more than a pinhole camera.
INITIAL_SIGMA_DEG = 0.25


@dataclass(frozen=True, eq=False)
class BearingPairs:
    """Pairs of bearings that may belong to the same points.

    Attributes
    ----------
    a, b
        (N, 3) unit bearings.
    covariance_a, covariance_b
        (N, 3, 3) covariances, square radians; zero along the bearing.
    is_noise_known
        False if the covariances hold only up to a common factor, which is to be estimated.
    """

    a: Array
    b: Array
    covariance_a: Array
    covariance_b: Array
    is_noise_known: bool

    @classmethod
    def of(
        cls,
        bearings_a: ArrayLike,
        bearings_b: ArrayLike,
        covariance_a: ArrayLike | None,
        covariance_b: ArrayLike | None,
        sigma_deg: ArrayLike | None,
    ) -> Self:
        """Check the arrays and normalize the bearings.

        Raises
        ------
        ValueError
            If shapes do not agree, a bearing is zero or not finite, a covariance is not positive, or both covariances
            and `sigma_deg` are given.
        """
        a, b = unit_bearings(bearings_a, "bearings_a"), unit_bearings(bearings_b, "bearings_b")
        if len(a) != len(b):
            raise ValueError(f"{len(a)} bearings of camera a and {len(b)} of camera b are not pairs")
        if (covariance_a is None) != (covariance_b is None):
            raise ValueError("give the covariances of both cameras, or of none")
        if covariance_a is not None and sigma_deg is not None:
            raise ValueError("give covariances or sigma_deg, not both")
        known = covariance_a is not None or sigma_deg is not None
        sigma = INITIAL_SIGMA_DEG if sigma_deg is None else sigma_deg
        return cls(
            a, b, tangent_covariances(a, covariance_a, sigma), tangent_covariances(b, covariance_b, sigma), known
        )

    def __len__(self) -> int:
        """Return the number of pairs."""
        return len(self.a)

    def __getitem__(self, use: NDArray[np.bool_] | NDArray[np.intp]) -> "BearingPairs":
        """Return the pairs of a mask (N,) or of indices."""
        rows = np.flatnonzero(use) if use.dtype == np.bool_ else use
        return replace(
            self,
            a=self.a.take(rows, axis=0),
            b=self.b.take(rows, axis=0),
            covariance_a=self.covariance_a.take(rows, axis=0),
            covariance_b=self.covariance_b.take(rows, axis=0),
        )

    @cached_property
    def variance(self) -> Array:
        """Variance (N,) of the angle between both bearings along any direction, square radians."""
        return isotropic_variance(self.covariance_a + self.covariance_b)

    @cached_property
    def arrays(self) -> tuple[Array, ...]:
        """Contiguous bearings, covariances (N, 3, 3) and mean variances (N,), each of camera a and b."""
        covariances = self.covariance_a, self.covariance_b
        return tuple(map(np.ascontiguousarray, (self.a, self.b, *covariances, *map(isotropic_variance, covariances))))

    def scaled(self, factor: float) -> "BearingPairs":
        """Return the pairs with standard deviations multiplied by a factor."""
        if factor == 1.0:
            return self
        square = factor**2
        return replace(self, covariance_a=square * self.covariance_a, covariance_b=square * self.covariance_b)


def isotropic_variance(covariance: Array) -> Array:
    """Return the mean variances (N,) in the tangent planes of covariances (N, 3, 3)."""
    return (covariance[:, 0, 0] + covariance[:, 1, 1] + covariance[:, 2, 2]) / 2  # np.trace takes five times as long


def unit_bearings(bearings: ArrayLike, name: str) -> Array:
    """Return bearings (N, 3) of unit length; raise ValueError if an array has another shape or a row no direction."""
    rows = np.asarray(bearings, float)
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise ValueError(f"{name} must have the shape (N, 3), got {rows.shape}")
    length = np.sqrt(np.einsum("ni,ni->n", rows, rows))  # np.linalg.norm takes three times as long
    bad = np.flatnonzero(~(np.isfinite(length) & (length > 0)))
    if len(bad):
        raise ValueError(f"{name}[{bad[0]}] is {rows[bad[0]]}: not a direction")
    return rows / length[:, None]


def tangent_covariances(bearings: Array, covariance: ArrayLike | None, sigma_deg: ArrayLike) -> Array:
    """Return covariances (N, 3, 3), square radians, in the tangent planes of bearings; isotropic ones if none is given.

    Raises
    ------
    ValueError
        If the shape is not (N, 3, 3), or a variance is not positive.
    """
    project = np.eye(3) - np.einsum("ni,nj->nij", bearings, bearings)
    if covariance is None:
        sigma = np.radians(np.asarray(sigma_deg, float))
        if sigma.ndim > 1 or sigma.shape not in ((), (len(bearings),)) or not ((sigma > 0) & (sigma < np.inf)).all():
            raise ValueError(f"sigma_deg must be positive and finite, one number or one per bearing, got {sigma_deg}")
        return sigma[..., None, None] ** 2 * project
    given = np.asarray(covariance, float)
    if given.shape != (len(bearings), 3, 3):
        raise ValueError(f"covariances must have the shape ({len(bearings)}, 3, 3), one per bearing, got {given.shape}")
    tangent = project @ given @ project
    bad = np.flatnonzero(~(isotropic_variance(tangent) > 0))
    if len(bad):
        raise ValueError(f"the covariance of bearing {bad[0]} is not positive across the bearing")
    return tangent
