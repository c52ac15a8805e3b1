"""Gains and vignetting of the cameras of a rig, estimated from the overlap in linear light."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Levels of 255 between which pixels are used: below is noise, above the sensor saturates in some channel.
MIN_LEVEL, MAX_LEVEL = 12, 245
# Even powers of the relative radius in the logarithm of the vignetting.
POWERS = (2, 4, 8)
# Standard deviation of logarithms of gains (two stops) and of coefficients of the vignetting (a loss of 26 % each).
GAIN_PRIOR, VIGNETTING_PRIOR = 1.4, 0.3
# Neighbouring pixels err together (parallax, reflections in the lens): an overlap has about as many independent ones.
INDEPENDENT_SAMPLES = 100
# Huber threshold of differences of logarithms: parallax and moving objects are outliers.
HUBER_LOG, ROUNDS = 0.1, 10
# The display encoding of sRGB in light is nearly a power.
DISPLAY_GAMMA = 2.2


@dataclass(frozen=True, eq=False)
class OverlapSamples:
    """Pixels of two cameras that show the same direction.

    Attributes
    ----------
    cameras
        Indices of both.
    colors
        (N, 3) of each, 0 to 255, as displayed.
    radius
        (N,) of each: distance from the principal point relative to the edge of the image circle.
    """

    cameras: tuple[int, int]
    colors: tuple[Array, Array]
    radius: tuple[Array, Array]


@dataclass(frozen=True, eq=False)
class Photometry:
    """Corrections of the cameras.

    Attributes
    ----------
    log_gain
        (C, 3) logarithm of the light that each camera and channel records relative to the mean of all.
    vignetting
        (3,) coefficients of the even powers of the relative radius in the logarithm of the light, common to all lenses.
    """

    log_gain: Array
    vignetting: Array

    def factor(self, camera: int, radius: Array) -> NDArray[np.float32]:
        """Return the factor (..., 3) of displayed colours that corrects a camera at relative radii (...)."""
        gain = np.exp(-self.log_gain[camera] / DISPLAY_GAMMA).astype(np.float32)
        return self.falloff(radius)[..., None] * gain

    def falloff(self, radius: Array) -> NDArray[np.float32]:
        """Return the factor (...) of displayed colours that corrects the vignetting at relative radii (...).

        Beyond the edge of the image circle, at 1, it is that of the edge.
        """
        # Horner's scheme in the squared radius is a tenth of the time of powers.
        square = np.square(np.minimum(radius, 1.0), dtype=np.float32)
        a, b, c = (np.float32(-each / DISPLAY_GAMMA) for each in self.vignetting)
        return np.exp(square * (a + square * (b + square * square * c)))


def estimate_photometry(samples: Sequence[OverlapSamples], count: int) -> Photometry:
    """Estimate gains and vignetting from all overlaps, by robust least squares of logarithms of light.

    Parameters
    ----------
    samples
        Pixels in each overlap.
    count
        Number of cameras C.
    """
    blocks: list[_Block] = []
    for part in samples:
        a, b = (np.asarray(c, float) for c in part.colors)
        use = ((a > MIN_LEVEL) & (a < MAX_LEVEL) & (b > MIN_LEVEL) & (b < MAX_LEVEL)).all(1)
        difference = np.log(_light(a[use])) - np.log(_light(b[use]))
        shape = np.stack([part.radius[0][use] ** p - part.radius[1][use] ** p for p in POWERS], -1)
        gains = np.column_stack([np.ones(len(shape)), shape])
        blocks += [
            _Block([3 * i + channel for i in part.cameras], gains, difference[:, channel]) for channel in range(3)
        ]
    x = _robust_solution(blocks, count)
    return Photometry(x[: 3 * count].reshape(count, 3), x[3 * count :])


class _Block(NamedTuple):
    """Equations of one channel of an overlap: design (N, 4) times (gain a - gain b, coefficients) = target (N,)."""

    gains: list[int]
    design: Array
    target: Array

    def unknowns(self, count: int) -> Array:
        """Return the matrix (4, 3 C + 3) that maps all unknowns to those of the block."""
        result = np.zeros((1 + len(POWERS), 3 * count + len(POWERS)))
        result[0, self.gains] = 1.0, -1.0
        result[1:, 3 * count :] = np.eye(len(POWERS))
        return result


def _robust_solution(blocks: Sequence[_Block], count: int) -> Array:
    """Return gains and coefficients by iteratively reweighted least squares; light only decreases with the radius.

    The normal equations are summed over the four unknowns of each block: the whole design of a million rows, most of
    them zeros, would take ten times as long.
    """
    from scipy.optimize import lsq_linear  # imported on use: scipy is slow to import

    sigma = np.concatenate([np.full(3 * count, GAIN_PRIOR), np.full(len(POWERS), VIGNETTING_PRIOR)])
    high = np.concatenate([np.full(3 * count, np.inf), np.full(len(POWERS), 1e-9)])
    x = np.zeros(len(sigma))
    weights = [np.ones(len(block.target)) for block in blocks]
    scale = INDEPENDENT_SAMPLES / max(sum(map(len, weights)) / 3, 1)
    for _ in range(ROUNDS):
        normal, right = np.diag((HUBER_LOG / sigma) ** 2), np.zeros(len(sigma))
        for block, weight in zip(blocks, weights, strict=True):
            weighted, unknowns = block.design * (scale * weight)[:, None], block.unknowns(count)
            normal += unknowns.T @ (weighted.T @ block.design) @ unknowns
            right += unknowns.T @ (weighted.T @ block.target)
        root = np.linalg.cholesky(normal)
        x = np.asarray(lsq_linear(root.T, np.linalg.solve(root, right), bounds=(np.full(len(x), -np.inf), high)).x)
        residuals = [np.abs(block.design @ (block.unknowns(count) @ x) - block.target) for block in blocks]
        weights = [HUBER_LOG / np.maximum(residual, HUBER_LOG) for residual in residuals]
    return x


def _light(levels: Array) -> Array:
    """Return the light of displayed levels (IEC 61966-2-1)."""
    value: Any = levels / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
