"""Keeping images from folding over inside the corners, where they nearly do (a logarithmic barrier).

Where an image just touches the fold inside, its whole rest is lost at once: the cost has a cliff there, and steps end
at its edge. With a wall before the edge they go along it.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.state import State
from omnisight.calibrate.views import BoardViews
from omnisight.geometry.sphere import angle_from_axis

Array = NDArray[np.float64]

# An image grows nearly no more where it grows less than this share of what it does on the axis.
FLAT = 0.05
# What a corner past such a place counts in the wall, in variances: too little to move a camera that stands off it.
WEIGHT = 1e-4


class Wall(NamedTuple):
    """The cost of a wall, its gradient (P,) and its Hessian (P, P)."""

    cost: float
    gradient: Array
    hessian: Array


def wall(state: State, views: BoardViews, variance: float) -> Wall | None:
    """Give the wall that a camera stands before; None where it stands before none."""
    dips = state.model.dips(FLAT)
    if not dips:
        return None
    angles = angle_from_axis(state.points(views)[0])
    cost, gradient, hessian = 0.0, np.zeros(state.model.params.size), 0.0
    for angle, growth, by_params in dips:
        weight = WEIGHT * variance * int((angles > angle).sum())
        share = growth / FLAT
        cost += weight * (share - 1 - np.log(share))
        gradient += weight * (1 / FLAT - 1 / growth) * by_params
        hessian += weight / growth**2 * np.outer(by_params, by_params)
    return Wall(cost, gradient, np.asarray(hessian))
