"""What each camera of a rig sees of each group: its pose, from the board with most corners, and a few corners."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.rigs.observations import RigObservations
from omnisight.calibration.rigs.poses import Poses
from omnisight.calibration.state import State
from omnisight.geometry.pose import Pose
from omnisight.models import Projector
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.intp]

# Corners of a board that are projected to compare relative poses.
COMPARED_CORNERS = 12


@dataclass(frozen=True, eq=False)
class Sightings:
    """The groups that a camera observes.

    Attributes
    ----------
    model, size
        Camera model, and size of the images, px.
    group
        (S,) groups, ascending.
    cam_from_group
        S poses.
    points, pixels
        (S, K, 3) corners in the frame of the group, and (S, K, 2) where they were observed.
    middle
        (S, 3) middle of the board in the frame of its group.
    half_turns
        S half turns of the board in the frame of its group, which look the same; the identity for other boards.
    is_symmetric
        Whether any board looks the same after half a turn.
    """

    model: Projector
    size: tuple[int, int]
    group: Indices
    cam_from_group: Poses
    points: Array
    pixels: Array
    middle: Array
    half_turns: Poses
    is_symmetric: bool

    def __len__(self) -> int:
        """Return the number of groups."""
        return len(self.group)

    @classmethod
    def of(
        cls,
        camera: int,
        observations: RigObservations,
        states: Sequence[State],
        group_from_board: Poses,
        symmetric: Sequence[bool],
    ) -> Self:
        """Return the groups that a camera observes.

        Parameters
        ----------
        camera
            Its index.
        observations, states
            Views of all cameras, and camera and board poses of each part.
        group_from_board
            Pose of each board in its rigid set.
        symmetric
            For each board, whether it looks the same after half a turn.
        """
        best: dict[int, tuple[int, int, int]] = {}
        for k in observations.parts_of(camera):
            part = observations.parts[k]
            for view, (group, rows) in enumerate(zip(part.group.tolist(), part.observations.groups, strict=True)):
                best[group] = max(best.get(group, (-1, -1, -1)), (rows.stop - rows.start, -k, -view))
        groups = sorted(best)
        views = [(-best[g][1], -best[g][2]) for g in groups]
        poses, turns = list[Pose](), list[Pose]()
        points, pixels, middles = list[Array](), list[Array](), list[Array]()
        for k, view in views:
            part = observations.parts[k]
            own, board = part.observations, group_from_board.one(part.board)
            rows = own.groups[view]
            chosen = np.linspace(rows.start, rows.stop - 1, COMPARED_CORNERS).round().astype(np.intp)
            poses.append(Pose(states[k].rotations[view], states[k].translations[view]) @ board.inverse())
            points.append(board @ own.points[chosen])
            pixels.append(own.pixels[chosen])
            middles.append(board @ board_middle(own))
            turns.append(board @ half_turn(own) @ board.inverse() if symmetric[part.board] else Pose())
        first = observations.parts_of(camera)[0]
        return cls(
            states[first].model,
            observations.parts[first].observations.size,
            np.array(groups, np.intp),
            Poses.of(*poses),
            np.array(points),
            np.array(pixels),
            np.array(middles),
            Poses.of(*turns),
            any(symmetric[observations.parts[k].board] for k, _ in views),
        )

    def at(self, index: Indices) -> Self:
        """Return some of the groups."""
        return type(self)(
            self.model,
            self.size,
            self.group[index],
            self.cam_from_group[index],
            self.points[index],
            self.pixels[index],
            self.middle[index],
            self.half_turns[index],
            self.is_symmetric,
        )

    def turned(self, which: Bools) -> Self:
        """Return the groups with the boards of some (S,) numbered from the opposite corner."""
        poses = (self.cam_from_group @ self.half_turns).where(which, self.cam_from_group)
        points = np.where(which[:, None, None], self.half_turns.transformed(self.points), self.points)
        return replace(self, cam_from_group=poses, points=points)

    def distances(self, cam_from_group: Poses) -> Array:
        """Return the median distance (S,), px, of the corners from their pixels; inf where none projects."""
        at = cam_from_group.transformed(self.points)
        pixels, valid = self.model.project_numpy(at.reshape(-1, 3))
        distance = np.linalg.norm(pixels.reshape(self.pixels.shape) - self.pixels, axis=-1)
        return np.median(np.where(valid.reshape(distance.shape), distance, np.inf), axis=1)


def board_middle(observations: Observations) -> Array:
    """Return the middle (3,) of a board in its frame."""
    return np.append(observations.extent.mean(0), 0.0)


def half_turn(observations: Observations) -> Pose:
    """Return the half turn of a symmetric board about its middle."""
    return Pose(np.diag([-1.0, -1.0, 1.0]), 2 * board_middle(observations))
