"""Logarithmic barrier that keeps a camera model injective where its image nearly folds inside the corners.

Where the projection stops growing with the off-axis angle, its domain ends, and the cost jumps by all corners beyond.
The barrier ends the cost smoothly: Levenberg-Marquardt steps follow the edge instead of stopping at it.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.state import State
from omnisight.geometry.sphere import angle_from_axis
from omnisight.models import Projector
from omnisight.models._projector import MIN_RELATIVE_GROWTH
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# Share of the distance to the barrier that one step may go: the usual fraction to the boundary is 0.9 to 0.995.
MAX_FRACTION_TO_BARRIER = 0.9


class LogBarrier(NamedTuple):
    """The cost of the barrier, its gradient (P,) and its Hessian (P, P)."""

    cost: float
    gradient: Array
    hessian: Array


def log_barrier(state: State, observations: Observations, variance: float) -> LogBarrier | None:
    """Return the barrier of a camera that nearly folds; None for one that does not.

    It begins at a relative growth of `MIN_RELATIVE_GROWTH`. Each corner beyond the fold adds one variance of a residual
    (px^2) as its unit.
    """
    if not (folds := state.model.near_folds):
        return None
    angles = angle_from_axis(state.points(observations)[0])
    cost, gradient, hessian = 0.0, np.zeros(state.model.params.size), 0.0
    for angle, growth, by_params in folds:
        weight = variance * int((angles > angle).sum())
        ratio = growth / MIN_RELATIVE_GROWTH
        cost += weight * (ratio - 1 - np.log(ratio))
        gradient += weight * (1 / MIN_RELATIVE_GROWTH - 1 / growth) * by_params
        hessian += weight / growth**2 * np.outer(by_params, by_params)
    return LogBarrier(cost, gradient, np.asarray(hessian))


def limit_step(model: Projector, step: Array) -> Projector:
    """Return the camera moved by a step of its parameters (P,), halved until it stays in bounds and off the barrier."""
    least = (1 - MAX_FRACTION_TO_BARRIER) * min((fold.growth for fold in model.near_folds), default=0.0)
    while True:
        moved = model.with_params(np.clip(model.params + step, *model.bounds))
        if not least or min((fold.growth for fold in moved.near_folds), default=MIN_RELATIVE_GROWTH) >= least:
            return moved
        step = step / 2
