"""Posing all boards by a camera, anew where they ended in a wrong place."""

from dataclasses import replace

import numpy as np

from omnisight.calibration.board_pose import linear_board_poses, refine_board_poses
from omnisight.calibration.state import State
from omnisight.models import CameraModel
from omnisight.targets.observations import Observations

# A view whose corners lie so many times farther off than those of the others may be resect wrongly.
ASTRAY = 4.0


def resect(model: CameraModel, views: Observations) -> State:
    """Pose every board from its bearings."""
    return resolve_flip(resect_linear(model, views), views)


def reresect(state: State, views: Observations) -> State:
    """Pose every board anew from its bearings, and keep what is better: heals a board stuck behind or turned over."""
    fresh = resect(state.model, views)
    starts = [g.start for g in views.groups]
    old, new = (np.add.reduceat(np.minimum(s.lengths(views), 50.0), starts) for s in (state, fresh))
    better = new < old
    return replace(
        state,
        rotations=np.where(better[:, None, None], fresh.rotations, state.rotations),
        translations=np.where(better[:, None], fresh.translations, state.translations),
    )


def has_pose_outlier(state: State, views: Observations) -> bool:
    """Say whether a view's corners lie so much farther off than those of others that its pose may be a wrong one."""
    lengths = state.lengths(views)
    medians = [float(np.median(lengths[rows])) for rows in views.groups]
    return max(medians) > ASTRAY * float(np.median(medians))


def resolve_flip(rough: State, views: Observations) -> State:
    """Pose every board from its bearings and a rough pose."""
    bearings, _ = rough.model.unproject_numpy(views.pixels)
    return State(rough.model, *refine_board_poses(views, bearings, rough.rotations, rough.translations))


def resect_linear(model: CameraModel, views: Observations) -> State:
    """Pose every board from its bearings, by linear equations alone."""
    bearings, _ = model.unproject_numpy(views.pixels)
    rotations, translations = linear_board_poses(views, bearings)
    # A board that cannot be resect stands far ahead until the camera is better known.
    lost = ~np.isfinite(rotations).all((1, 2))
    rotations[lost], translations[lost] = np.eye(3), (0.0, 0.0, 1e3)
    return State(model, rotations, translations)
