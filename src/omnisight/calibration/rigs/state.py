"""The unknowns of the calibration of a rig."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.rigs.observations import RigObservations, RigPart
from omnisight.calibration.state import State
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.models import Projector

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Poses:
    """Rigid motions b_from_a of several frames.

    Attributes
    ----------
    rotation, translation
        (N, 3, 3) and (N, 3).
    """

    rotation: Array
    translation: Array

    def __len__(self) -> int:
        """Return the number of poses."""
        return len(self.rotation)

    def __getitem__(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> "Poses":
        """Return some of the poses."""
        return Poses(self.rotation[index], self.translation[index])

    def __matmul__(self, other: "Poses") -> "Poses":
        """Compose each pose with the pose of the same index; a single pose is composed with all."""
        return Poses(
            self.rotation @ other.rotation,
            (self.rotation @ other.translation[..., None])[..., 0] + self.translation,
        )

    @classmethod
    def of(cls, *poses: Pose) -> Self:
        """Join poses."""
        return cls(np.array([p.rotation for p in poses]), np.array([p.translation for p in poses]))

    @classmethod
    def identity(cls, count: int) -> Self:
        """Return poses that change nothing."""
        return cls(np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)))

    def one(self, index: int) -> Pose:
        """Return one of the poses."""
        return Pose(self.rotation[index], self.translation[index])

    def inverse(self) -> "Poses":
        """Return a_from_b."""
        back = np.swapaxes(self.rotation, 1, 2)
        return Poses(back, -(back @ self.translation[..., None])[..., 0])

    def moved(self, steps: Array) -> "Poses":
        """Return the poses moved by steps (N, 6), see `Pose.moved`."""
        return Poses(so3.exp(steps[:, :3]) @ self.rotation, self.translation + steps[:, 3:])


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
    """

    models: tuple[Projector, ...]
    sensor_from_rig: Poses
    rig_from_group: Poses
    group_from_board: Poses
    warps: Array
    time_offsets: Array
    velocities: Array

    def cam_from_board(self, part: RigPart) -> Poses:
        """Return the pose of the board in every view of a part."""
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
