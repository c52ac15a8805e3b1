"""Result of fitting an image model at each of N points, and the limits that all such fits share."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Half the contrast, in gray levels, below which a pattern cannot be distinguished from noise: a two-tone window of this
# amplitude has a variance of its square.
MIN_AMPLITUDE = 3.0
# Standard deviation of the blur, px: below, pixels hide it; above, no window holds both sides of an edge.
BLUR_RANGE_PX = (0.3, 8.0)
# Variance of a gray level rounded to an integer: no image has less noise.
ROUNDING_VARIANCE = 1 / 12
# Larger inflations of a covariance come from model errors, not from correlated noise.
MAX_NOISE_INFLATION = 8.0
# Iterations of any fit or growth: each converges in fewer or not at all.
MAX_ITERATIONS = 12


class PointFits(NamedTuple):
    """Fits of N points; NaN where a fit failed.

    Attributes
    ----------
    pixels : (N, 2) array
    covariance : (N, 2, 2) array
        Of `pixels`, px^2, from the residuals of the fit and their correlation between neighbouring pixels.
    amplitude : (N,) array
        Half the contrast in gray levels. Corner: positive if the quadrant between both steps is the brighter one.
        Ellipse: positive if its inside is brighter. Marker: positive if it is darker than the paper.
    blur : (N,) array
        Standard deviation of the blur, px.
    explained : (N,) array
        Share of the variance in the window that the model explains, 0 to 1.
    """

    pixels: Array
    covariance: Array
    amplitude: Array
    blur: Array
    explained: Array

    @classmethod
    def empty(cls, count: int) -> "PointFits":
        """Return `count` failed fits."""
        return cls(np.full((count, 2), np.nan), np.full((count, 2, 2), np.nan), *np.full((3, count), np.nan))

    def with_noise_inflation(self, inflation: float, model_error_px: float) -> "PointFits":
        """Scale the covariance by the effect of correlated noise and add the error of the model itself."""
        scale = float(np.clip(inflation, 1.0, MAX_NOISE_INFLATION))
        return self._replace(covariance=self.covariance * scale + model_error_px**2 * np.eye(2))


def contiguous_gray(gray: NDArray[Any]) -> NDArray[np.uint8]:
    """Return a gray image in the one memory layout that compiled loops are compiled for."""
    return np.require(gray, np.uint8, ["C", "W"])
