"""Image orientation: whether some images of a camera were mirrored or rotated by 180° after they were taken."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.bundle_adjustment import Bundle, refine
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.resection import resect
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import State
from omnisight.targets.observations import Observations

# Direction of u and v in the changed images.
DIRECTIONS = {"mirrored": (-1.0, 1.0), "mirrored upside-down": (1.0, -1.0), "rotated by 180°": (-1.0, -1.0)}


def find_orientation(
    first: State, observations: Observations, is_second: NDArray[np.bool_], weights: ResidualWeights, max_cost: float
) -> str:
    """Return how some images differ from the others, if one camera then fits all of them; else an empty text.

    Parameters
    ----------
    first
        The camera of the other images.
    observations
        All views.
    is_second
        (V,) views of the images that may have been changed.
    weights
        Weights of the corners.
    max_cost
        Cost of the camera of all images above which the orientation does not explain the difference.
    """
    costs = dict[str, float]()
    for name, direction in DIRECTIONS.items():
        restored = restore(observations, is_second, np.array(direction))
        start = replace(resect(first.central_model, restored), model=first.model, warp=first.warp)
        free = FreeParameters.of(start.model)
        state = refine(start, restored, free_parameters=free, weights=weights).state
        costs[name] = Bundle(restored, free, weights).cost(state)
    best = min(costs, key=lambda name: costs[name])
    return best if costs[best] <= max_cost else ""


def restore(observations: Observations, is_second: NDArray[np.bool_], direction: NDArray[np.float64]) -> Observations:
    """Return observations with the pixels of some views (V,) mirrored along u, v or both: u becomes width - 1 - u."""
    rows = observations.rows(np.flatnonzero(is_second))
    pixels, covariance = observations.pixels.copy(), observations.covariance.copy()
    last = np.array(observations.size) - 1.0
    pixels[rows] = np.where(direction < 0, last - pixels[rows], pixels[rows])
    covariance[rows] *= np.outer(direction, direction)
    return replace(observations, pixels=pixels, covariance=covariance)
