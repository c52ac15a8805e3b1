"""The state of the calibration of a non-central camera, in the frame of its central limit."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.state import State
from omnisight.optics.central_limit import CentralLimit
from omnisight.optics.ray_model import RayModel
from omnisight.optics.viewpoint import best_viewpoint

Array = NDArray[np.float64]


def in_central_frame(state: State, model: RayModel, pixels: Array) -> State:
    """Return the state in the frame of the central limit, about the point nearest to the rays of pixels (N, 2).

    After a mirror, which reverses handedness, points of boards are correct but the "rotations" are reflections.
    """
    far = CentralLimit(model)
    centre = best_viewpoint(model, pixels).point
    return replace(
        state,
        model=far,
        rotations=far.axes[:, None] * state.rotations,
        translations=far.axes * (state.translations - centre),
    )
