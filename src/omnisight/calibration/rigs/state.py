"""The unknowns of the calibration of a rig."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.rigs.board_motion import with_motion
from omnisight.calibration.rigs.observations import RigObservations, RigPart
from omnisight.calibration.rigs.poses import Poses
from omnisight.calibration.state import State
from omnisight.models import Projector

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class RigState:
    """Cameras, extrinsics, board poses, board warps and time offsets.

    A view of camera c, group g and board b has cam_from_board = sensor_from_rig[c] @ rig_from_group[g] @
    group_from_board[b]. The rig frame is that of the first camera, the frame of a group that of the first board.

    Attributes
    ----------
    models
        Model of each of the C cameras.
    sensor_from_rig
        C poses.
    rig_from_group
        G poses; those of groups that no camera observes have no meaning.
    group_from_board
        B poses of boards that are rigidly connected; the identity for boards that are not.
    warps
        (B, 2) board warps, see `State`.
    time_offsets
        (C,) time, in seconds, of the images of each camera after those of the first.
    velocities
        (G, 6) motion of `rig_from_group` per second, as steps (w, v) of `Pose.moved`; constant in an optimization.
    motion
        For each camera (V, 6) small motions of the board in each view, see `board_motion`; none if it is at rest.
    """

    models: tuple[Projector, ...]
    sensor_from_rig: Poses
    rig_from_group: Poses
    group_from_board: Poses
    warps: Array
    time_offsets: Array
    velocities: Array
    motion: tuple[Array, ...] = ()

    def cam_from_board(self, part: RigPart) -> Poses:
        """Return the pose of the board in every view of a part."""
        poses = self.cam_from_still_board(part)
        return with_motion(poses, part, self.motion[part.camera]) if self.motion else poses

    def cam_from_still_board(self, part: RigPart) -> Poses:
        """Return the pose of the board in every view of a part, without its motion."""
        return self._sensor(part) @ self.rig_from_board(part)

    def rig_from_board(self, part: RigPart) -> Poses:
        """Return the pose of the board, in the rig frame, in every view of a part."""
        seconds = part.delays + self.time_offsets[part.camera]
        moved = self.rig_from_group[part.group].moved(seconds[:, None] * self.velocities[part.group])
        return moved @ self.group_from_board[np.full(len(part), part.board)]

    def part_state(self, part: RigPart) -> State:
        """Return camera, board poses and warp of one part."""
        poses = self.cam_from_board(part)
        return State(self.models[part.camera], poses.rotation, poses.translation, self.warps[part.board])

    def lengths(self, observations: RigObservations) -> list[Array]:
        """Return the residual lengths (N,), px, of every part."""
        return [self.part_state(part).lengths(part.observations) for part in observations.parts]

    def of_groups(self, kept: Bools) -> "RigState":
        """Return the state of some of the groups (G,)."""
        return replace(self, rig_from_group=self.rig_from_group[kept], velocities=self.velocities[kept])

    def _sensor(self, part: RigPart) -> Poses:
        return self.sensor_from_rig[np.full(len(part), part.camera)]
