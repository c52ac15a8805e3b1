"""Derivatives of the board poses of a rig by its extrinsics, groups, boards, time offsets and motions."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.rigs.board_motion import by_motion, by_pose
from omnisight.calibration.rigs.observations import RigPart
from omnisight.calibration.rigs.rig_free_parameters import RigFreeParameters
from omnisight.calibration.rigs.state import RigState
from omnisight.geometry import rotation as so3

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


class PoseDerivatives(NamedTuple):
    """Derivatives of cam_from_board of every view of a part; all steps are those of `Pose.moved`.

    Attributes
    ----------
    columns
        (Q,) the shared parameters that the poses depend on: extrinsics, pose of the board, time offset.
    by_shared
        (V, 6, Q) derivatives by them.
    by_group, by_motion
        (V, 6, 6) derivatives by the pose of the group, and by the motion of the exposure.
    """

    columns: Indices
    by_shared: Array
    by_group: Array
    by_motion: Array


def pose_derivatives(state: RigState, part: RigPart, exposures: Indices, free: RigFreeParameters) -> PoseDerivatives:
    """Return the derivatives of cam_from_board of every view of a part."""
    sensor = state.sensor_from_rig.rotation[part.camera]
    in_rig, pivot = state.rig_from_views(part), state.pivots[part.board]
    still, moved = state.cam_from_still_group(part), state.cam_from_group(part, exposures)
    # A rotation of cam_from_group moves the origin of the board.
    to_board = _with_arm(moved.rotation @ state.group_from_board.translation[part.board])
    to_moved = to_board if state.motion is None else to_board @ by_pose(still, pivot, state.motion[exposures])
    by_sensor = to_moved @ _with_arm(in_rig.translation @ sensor.T)
    by_group = to_moved @ _rotated(np.broadcast_to(sensor, (len(part), 3, 3)))
    by_time = by_group @ state.velocities[part.group][..., None]
    turn = so3.exp((part.delays + state.time_offsets[part.camera])[:, None] * state.velocities[part.group, :3])
    by_group[:, :, :3] = by_group[:, :, :3] @ turn  # the group turns before it moves on
    blocks = (
        (free.extrinsic_columns(part.camera), by_sensor),
        (free.columns("board", part.board, 6), _rotated(moved.rotation)),
        (free.columns("time", part.camera, 1), by_time),
    )
    used = [(columns, block) for columns, block in blocks if len(columns)]
    columns = np.concatenate([np.arange(0), *(c for c, _ in used)])
    by_shared = np.concatenate([np.zeros((len(part), 6, 0)), *(b for _, b in used)], axis=2)
    return PoseDerivatives(columns, by_shared, by_group, to_board @ by_motion(moved, pivot))


def _with_arm(arms: Array) -> Array:
    """Return the derivative (V, 6, 6) of poses by a step of the frame at whose arm (V, 3) their origin is."""
    derivative = np.zeros((len(arms), 6, 6))
    derivative[:, range(6), range(6)] = 1.0
    derivative[:, 3:, :3] = -so3.hat(arms)
    return derivative


def _rotated(rotations: Array) -> Array:
    """Return the derivative (V, 6, 6) of poses by a step of a frame that rotations (V, 3, 3) turn into theirs."""
    derivative = np.zeros((len(rotations), 6, 6))
    derivative[:, :3, :3] = derivative[:, 3:, 3:] = rotations
    return derivative
