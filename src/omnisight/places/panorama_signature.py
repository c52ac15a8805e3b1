"""Appearance of a panorama without its brightness and contrast."""

from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.stats import rankdata

Array = NDArray[np.float64]

# Standard deviation of the smoothing before a first refinement. It widens the basin to the displacement of columns by a
# translation of a quarter of the distance of the surroundings.
SMOOTHING_RAD = 0.25
# Two neighbouring columns whose gray values are all within this share of the range of the image show a mask or a cover.
UNIFORM_SHARE = 0.01
# Fewer rows are equal by chance.
MIN_ROWS = 8
# Share of the columns above which uniform ones are part of the surroundings.
MAX_UNIFORM_SHARE = 0.75


class PanoramaSignature:
    """Appearance of a panorama without its brightness and contrast.

    Gray values are replaced by their ranks, on which an increasing function of the gray values has no effect. The
    mean of each row, which does not depend on the heading, is subtracted.

    Attributes
    ----------
    values
        (H, W), of norm 1; zero in columns that are not observed, and if the panorama is uniform along its rows.
    observed
        (W,) columns that show the surroundings, and not a mask or a cover.
    """

    def __init__(self, gray: NDArray[np.generic], row_weights: Array | None = None) -> None:
        self.observed = _observed_columns(np.asarray(gray, float))
        ranks = np.zeros(gray.shape)
        ranks[:, self.observed] = rankdata(gray[:, self.observed]).reshape(len(gray), -1)
        values = np.where(self.observed, ranks - ranks[:, self.observed].mean(axis=1, keepdims=True), 0.0)
        self.values = normalized(values if row_weights is None else values * np.sqrt(row_weights)[:, None])

    @classmethod
    def of(cls, values: Array, observed: NDArray[np.bool_]) -> Self:
        """Return the signature with values (H, W), which are normalized, in observed columns (W,)."""
        signature = cls.__new__(cls)
        signature.values, signature.observed = normalized(np.where(observed, values, 0.0)), observed
        return signature

    @property
    def is_uniform(self) -> bool:
        """Whether nothing in the panorama depends on the heading."""
        return not self.values.any()

    @cached_property
    def spectrum(self) -> NDArray[np.complex64]:
        """Fourier transforms (H, F) of the rows."""
        return np.fft.rfft(self.values, axis=1).astype(np.complex64)

    @cached_property
    def mask_spectrum(self) -> NDArray[np.complex128]:
        """Fourier transform (F,) of `observed`."""
        return np.fft.rfft(self.observed.astype(float))

    @cached_property
    def energy_spectrum(self) -> NDArray[np.complex128]:
        """Fourier transform (F,) of the sums of squares of the columns."""
        return np.fft.rfft((self.values**2).sum(axis=0))

    @cached_property
    def smoothed(self) -> Self:
        """The signature of the panorama smoothed along its rows."""
        frequencies = np.arange(self.values.shape[1] // 2 + 1)
        return self.filtered(np.exp(-((frequencies * SMOOTHING_RAD) ** 2) / 2))

    def filtered(self, gain: Array) -> Self:
        """Return the signature of the panorama whose rows are multiplied by gains (F,) of their frequencies."""
        values = np.fft.irfft(np.fft.rfft(self._interpolated, axis=1) * gain, n=self.values.shape[1], axis=1)
        return self.of(values, self.observed)

    @cached_property
    def rows(self) -> CubicSpline:
        """Periodic cubic splines of the rows."""
        values = self._interpolated
        closed = np.concatenate([values, values[:, :1]], axis=1)
        return CubicSpline(np.arange(closed.shape[1]), closed.T, bc_type="periodic")

    def observed_at(self, positions: Array) -> NDArray[np.bool_]:
        """Return whether the columns on both sides of positions (N,), columns, are observed."""
        left = np.floor(positions).astype(int)
        columns = len(self.observed)
        return self.observed[left % columns] & self.observed[(left + 1) % columns]

    @property
    def _interpolated(self) -> Array:
        """The values, linear between the observed columns."""
        if self.observed.all():
            return self.values
        columns = np.arange(len(self.observed))
        known = columns[self.observed]
        return np.stack([np.interp(columns, known, row[known], period=len(columns)) for row in self.values])


def normalized(values: Array) -> Array:
    """Return an array divided by its norm, if that is not zero."""
    norm = float(np.linalg.norm(values))
    return values / norm if norm > 0 else values


def _observed_columns(gray: Array) -> NDArray[np.bool_]:
    """Return the columns (W,) of a panorama (H, W) that are not uniform together with a neighbour."""
    if len(gray) < MIN_ROWS:
        return np.ones(gray.shape[1], bool)
    low, high = gray.min(axis=0), gray.max(axis=0)
    limit = UNIFORM_SHARE * (high.max() - low.min())
    is_uniform_pair = np.maximum(high, np.roll(high, -1)) - np.minimum(low, np.roll(low, -1)) <= limit
    observed = ~(is_uniform_pair | np.roll(is_uniform_pair, 1))
    return observed if observed.mean() > 1 - MAX_UNIFORM_SHARE else np.ones(len(observed), bool)
