"""Fitting cameras of rays to boards: the same bundle adjustment as for central ones."""

from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.candidate import Candidate
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.model_selection import TIE
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import MIN_OUTSIDE_COST_PX, State
from omnisight.models import CameraModel
from omnisight.optics.models.axial import Axial
from omnisight.optics.ray_model import RayModel
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# Cost, as a share, that a fit may still have to fall.
TOLERANCE = 1e-6


def with_rays(state: State, model: RayModel) -> State:
    """Give the state with a camera of rays: a bundle asks of it what it asks of any camera."""
    return replace(state, model=cast(CameraModel, model))


def fit(name: str, start: State, views: Observations, freedom: FreeParameters, *, loss: str) -> Candidate:
    """Refine a camera on all images, from a state that is near."""
    spread = ResidualWeights.of(start, views, loss)
    while True:
        state = refine(start, views, freedom=freedom, spread=spread, tolerance=TOLERANCE).state
        before, spread = spread, ResidualWeights.of(state, views, loss)
        if spread.like(before):
            break
        start = state
    return Candidate.found(name, state, views, freedom)


def axial_of(central: Candidate, views: Observations, count: int, *, loss: str) -> Candidate:
    """Let the viewpoint of a central candidate move along its axis, with so many coefficients.

    Of the lens is estimated what was: pixels that were held square stay so.
    """
    start = with_rays(central.state, Axial(central.state.model, (0.0,) * count))
    directions = block_diag(central.freedom.directions, np.eye(count))
    freedom = FreeParameters(np.asarray(directions, float), central.freedom.warp)
    return fit(f"axial {central.name}, {count}", start, views, freedom, loss=loss)


def clearly_better(one: Candidate, other: Candidate, views: Observations, usable: NDArray[np.bool_]) -> bool:
    """Say whether a candidate explains images held out better than another by more than chance.

    By more than a hundredth of the other's, and by more than the standard error, over the images, of the difference
    of their squares; only corners that lie inside both cameras' domains count.
    """
    assert one.held_out_lengths is not None
    assert other.held_out_lengths is not None
    mine, its = one.held_out_lengths, other.held_out_lengths
    use = usable & (mine < MIN_OUTSIDE_COST_PX) & (its < MIN_OUTSIDE_COST_PX)
    if np.sqrt((mine[use] ** 2).mean()) >= (1 - TIE) * np.sqrt((its[use] ** 2).mean()):
        return False
    gained = np.bincount(views.view_of_row, np.where(use, its**2 - mine**2, 0.0), len(views))
    return bool(gained.mean() > gained.std(ddof=1) / np.sqrt(len(views)))
