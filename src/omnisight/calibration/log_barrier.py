"""Keeping images from folding over inside the corners, where they nearly do (a logarithmic barrier).

Where an image just touches the fold inside, its whole rest is lost at once: the cost has a cliff there, and steps end
at its edge. With a log_barrier before the edge they go along it.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.state import State
from omnisight.geometry.sphere import angle_from_axis
from omnisight.models import CameraModel
from omnisight.models._protocol import MIN_RELATIVE_GROWTH
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# What a corner past such a place counts in the barrier, in variances: a camera that stands off it hardly moves, and before
# it there is room for steps along it.
WEIGHT = 1.0
# Share of the way to a log_barrier that a step goes at most: right before it, steps are short.
NEARER = 0.9


class LogBarrier(NamedTuple):
    """The cost of a log_barrier, its gradient (P,) and its Hessian (P, P)."""

    cost: float
    gradient: Array
    hessian: Array


def log_barrier(state: State, views: Observations, variance: float) -> LogBarrier | None:
    """Give the log_barrier that a camera stands before; None where it stands before none."""
    if not (dips := state.model.near_folds):
        return None
    angles = angle_from_axis(state.points(views)[0])
    cost, gradient, hessian = 0.0, np.zeros(state.model.params.size), 0.0
    for angle, growth, by_params in dips:
        weight = WEIGHT * variance * int((angles > angle).sum())
        share = growth / MIN_RELATIVE_GROWTH
        cost += weight * (share - 1 - np.log(share))
        gradient += weight * (1 / MIN_RELATIVE_GROWTH - 1 / growth) * by_params
        hessian += weight / growth**2 * np.outer(by_params, by_params)
    return LogBarrier(cost, gradient, np.asarray(hessian))


def limit_step(model: CameraModel, step: Array) -> CameraModel:
    """Give the camera moved by a step of its parameters (P,), kept within bounds and before what walls it is before."""
    least = (1 - NEARER) * min((dip.growth for dip in model.near_folds), default=0.0)
    while True:
        moved = model.with_params(np.clip(model.params + step, *model.bounds))
        if not least or min((dip.growth for dip in moved.near_folds), default=MIN_RELATIVE_GROWTH) >= least:
            return moved
        step = step / 2
