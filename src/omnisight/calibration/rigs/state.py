"""The unknowns of the calibration of a rig."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.rigs.board_motion import with_motion
from omnisight.calibration.rigs.observations import RigObservations, RigPart
from omnisight.calibration.rigs.poses import Poses
from omnisight.calibration.state import State
from omnisight.display import Displayed
from omnisight.models import Projector

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class RigState(Displayed):
    """Cameras, extrinsics, board poses, board warps and time offsets.

    A view of camera c, group g and board b has cam_from_board = sensor_from_rig[c] @ rig_from_group[g] @
    group_from_board[b]. The rig frame is that of the first camera, the frame of a group that of the first board of its
    rigid set.

    Attributes
    ----------
    models
        Model of each of the C cameras.
    sensor_from_rig
        C poses.
    rig_from_group
        G poses; those of groups that no camera observes have no meaning.
    group_from_board
        B poses relative to the first board of the rigid set of each board; its own is the identity.
    warps
        (B, 2) board warps, see `State`.
    time_offsets
        (C,) time, in seconds, of the images of each camera after those of the first.
    velocities
        (G, 6) motion of `rig_from_group` per second, as steps (w, v) of `Pose.moved`; constant in an optimization.
    pivots
        (B, 3) point about which the rigid set of each board moves, in the frame of its groups.
    motion
        (E, 6) small motion of the boards in each exposure, see `board_motion`; None if they are at rest.
    """

    models: tuple[Projector, ...]
    sensor_from_rig: Poses
    rig_from_group: Poses
    group_from_board: Poses
    warps: Array
    time_offsets: Array
    velocities: Array
    pivots: Array
    motion: Array | None = field(default=None)

    def cam_from_board(self, part: RigPart, exposures: Indices) -> Poses:
        """Return the pose of the board in every view of a part; `exposures` (V,) are those of its views."""
        return self.cam_from_group(part, exposures) @ self._board(part)

    def cam_from_group(self, part: RigPart, exposures: Indices) -> Poses:
        """Return the pose of the group in every view of a part."""
        poses = self.cam_from_still_group(part)
        if self.motion is None:
            return poses
        return with_motion(poses, self.pivots[part.board], self.motion[exposures])

    def cam_from_still_group(self, part: RigPart) -> Poses:
        """Return the pose of the group in every view of a part, without the motion of the boards."""
        return self.sensor_from_rig[np.full(len(part), part.camera)] @ self.rig_from_views(part)

    def rig_from_views(self, part: RigPart) -> Poses:
        """Return the pose of the group, in the rig frame, at the time of every view of a part."""
        seconds = part.delays + self.time_offsets[part.camera]
        return self.rig_from_group[part.group].moved(seconds[:, None] * self.velocities[part.group])

    def rig_from_board(self, part: RigPart) -> Poses:
        """Return the pose of the board, in the rig frame, in every view of a part, without its motion."""
        return self.rig_from_views(part) @ self._board(part)

    def part_state(self, part: RigPart, exposures: Indices) -> State:
        """Return camera, board poses and warp of one part."""
        poses = self.cam_from_board(part, exposures)
        return State(self.models[part.camera], poses.rotation, poses.translation, self.warps[part.board])

    def part_states(self, observations: RigObservations) -> list[State]:
        """Return camera, board poses and warp of every part."""
        return [self.part_state(part, observations.exposures_of(part)) for part in observations.parts]

    def lengths(self, observations: RigObservations) -> list[Array]:
        """Return the residual lengths (N,), px, of every part."""
        return [
            state.lengths(part.observations)
            for part, state in zip(observations.parts, self.part_states(observations), strict=True)
        ]

    def of_groups(self, observations: RigObservations, kept: Bools) -> "RigState":
        """Return the state of some of the groups (G,) of observations."""
        motion = None if self.motion is None else self.motion[kept[observations.exposures[1]]]
        return replace(self, rig_from_group=self.rig_from_group[kept], velocities=self.velocities[kept], motion=motion)

    def _board(self, part: RigPart) -> Poses:
        return self.group_from_board[np.full(len(part), part.board)]
