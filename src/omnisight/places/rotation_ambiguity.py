"""Probability that the rotation between two panoramas is at another maximum of their correlation."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.places.panorama_signature import Array, PanoramaSignature

# Sectors of the panorama whose errors are regarded as independent.
SECTORS = 12
# Random weights of the sectors: the probability of a maximum is accurate to 4 %.
REPLICATES = 128
# Largest squared correlation: rounding errors.
MAX_CORRELATION_SQUARED = 1 - 1e-12


def ambiguity(query: PanoramaSignature, reference: PanoramaSignature, residuals: Array, rotation: float) -> float:
    """Return the variance of a rotation, columns squared, because another maximum of the correlation may be right.

    The likelihood of a rotation with the correlation c is (1 - c²)^(-N/2), where N is the number of independent
    residuals: with the power spectrum S, (sum S)² / sum S². Light and unequal distances cause differences that are
    common to a sector of the panorama: the likelihoods are averaged over random weights of the sectors (D. B. Rubin,
    The Bayesian bootstrap, The Annals of Statistics 9(1), 1981).

    Parameters
    ----------
    query, reference
        Panoramas of the same size.
    residuals
        (H, W) differences at the estimated rotation.
    rotation
        The estimate, columns.
    """
    columns = residuals.shape[1]
    power = np.abs(np.fft.fft2(residuals)) ** 2
    if not power.any():
        return 0.0
    independent = power.sum() ** 2 / (power**2).sum()
    sectors = sector_edges(columns)
    weights = np.random.default_rng(0).exponential(size=(REPLICATES, len(sectors)))
    log_likelihood = _log_likelihood(query, reference, np.vstack([np.ones(len(sectors)), weights])) * independent
    whole, resampled = log_likelihood[0], log_likelihood[1:]
    peaks = np.flatnonzero((whole > np.roll(whole, 1)) & (whole >= np.roll(whole, -1)) & (whole > 0))
    if not len(peaks):  # nothing in common: all rotations are equally likely
        return columns**2 / 12
    probability = np.exp(resampled - resampled.max(axis=1, keepdims=True))
    probability = (probability / probability.sum(axis=1, keepdims=True)).mean(axis=0)
    nearest = peaks[np.abs(periodic(peaks[:, None] - np.arange(columns), columns)).argmin(axis=0)]
    estimated = nearest[int(np.round(rotation)) % columns]
    return float(probability @ periodic(nearest - estimated, columns) ** 2)


def sector_edges(columns: int) -> NDArray[np.intp]:
    """Return the first column of each sector."""
    return np.linspace(0, columns, min(SECTORS, columns) + 1).astype(np.intp)[:-1]


def periodic(offsets: NDArray[Any], columns: int) -> Array:
    """Return offsets, columns, within half a turn."""
    return offsets - columns * np.round(offsets / columns)


def _log_likelihood(query: PanoramaSignature, reference: PanoramaSignature, weights: Array) -> Array:
    """Return the log-likelihoods (B, W) of rotations per independent residual, for weights (B, S) of the sectors."""
    columns = query.values.shape[1]
    column = np.arange(columns)[:, None]
    rotated = (column + column.T) % columns  # column of the reference at a column and rotation
    edges = sector_edges(columns)

    def weighted(of_columns: NDArray[Any]) -> Array:
        return weights @ np.add.reduceat(of_columns, edges, axis=0)

    energy_q, energy_r = ((each.values**2).sum(axis=0) for each in (query, reference))
    products = weighted((query.values.T @ reference.values)[column, rotated])
    energies = weighted(energy_q[:, None] * reference.observed[rotated]) * weighted(
        query.observed[:, None] * energy_r[rotated]
    )
    share = weighted(query.observed[:, None] & reference.observed[rotated]) / weights.sum(axis=1, keepdims=True)
    correlation = np.maximum(products, 0.0) / np.sqrt(np.maximum(energies, np.finfo(float).tiny))
    common = share * len(edges) / columns
    return -common / 2 * np.log1p(-np.minimum(correlation**2, MAX_CORRELATION_SQUARED))
