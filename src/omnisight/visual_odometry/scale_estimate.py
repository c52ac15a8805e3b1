"""The scale of a trajectory, with its uncertainty and where it comes from."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.display import Displayed
from omnisight.optim.loss import NORMAL_MEDIAN

Array = NDArray[np.float64]

# Relative standard deviation above which a scale is unknown.
MAX_RELATIVE_SIGMA = 0.1
# Independent measurements from which the scatter is estimated.
MIN_MEASUREMENTS = 4
# Of a normal distribution: the standard deviation of the median of many values over that of their mean.
MEDIAN_TO_MEAN_SIGMA = float(np.sqrt(np.pi / 2))


@dataclass(frozen=True)
class ScaleEstimate(Displayed):
    """Metres per unit of a trajectory; false if it is unknown.

    Attributes
    ----------
    source
        Where it comes from.
    metres
        Metres per unit of the world; NaN if unknown.
    relative_sigma
        Standard deviation relative to it.
    reason
        Why it is unknown; empty otherwise.
    """

    source: str
    metres: float = float("nan")
    relative_sigma: float = float("nan")
    reason: str = ""

    def __bool__(self) -> bool:
        return not self.reason

    @classmethod
    def checked(cls, source: str, metres: float, relative_sigma: float) -> "ScaleEstimate":
        """Return a scale, unknown if it is not positive or too uncertain."""
        if not abs(relative_sigma) < MAX_RELATIVE_SIGMA:
            return cls(source, reason=f"the scale from {source} is uncertain by {abs(relative_sigma):.0%} (1σ)")
        if not metres > 0:
            return cls(source, reason=f"the scale from {source} would be {metres:.3g}, which is not positive")
        return cls(source, metres, relative_sigma)


def robust_mean(values: Array) -> tuple[float, float]:
    """Return the median of values (N,), and its standard deviation for normal errors with outliers."""
    center = float(np.median(values))
    scatter = float(np.median(np.abs(values - center))) / NORMAL_MEDIAN
    return center, MEDIAN_TO_MEAN_SIGMA * scatter / float(np.sqrt(max(len(values) - 1, 1)))
