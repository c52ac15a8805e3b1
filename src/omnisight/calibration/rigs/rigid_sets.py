"""Which boards are rigidly connected, from the images in which one camera sees two of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from omnisight.calibration.bundle_adjustment import Bundle
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.rigs.observations import AGREES, RigObservations
from omnisight.calibration.rigs.pose_steps import POSE_DOF, contradiction_limit, robust_mean, squared_distances
from omnisight.calibration.rigs.poses import Poses
from omnisight.calibration.state import State
from omnisight.display import Displayed
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.intp]

# Images that show two boards, below which one wrong pose could not be recognized.
MIN_COMMON_VIEWS = 3
# Share of these images in which the relative pose must be the same. A board that is put elsewhere during the recording
# is treated as moving; a few wrong poses are not.
MIN_RIGID_SHARE = 0.7
# Largest ratio of the squared deviations to those of corner noise that the errors of cameras calibrated alone may
# explain: five times the noise. A larger motion between two images is one of the board.
MAX_INFLATION = 25.0


@dataclass(frozen=True, eq=False)
class BoardRelation(Displayed):
    """The relative pose of two boards in the images that show both.

    Attributes
    ----------
    a, b
        Indices of the boards.
    a_from_b
        The relative pose that most images agree on.
    parts, views
        (I,) part of the observations, and view, of board b in each image.
    agrees
        (I,) whether the pose in the image agrees.
    """

    a: int
    b: int
    a_from_b: Pose
    parts: Indices
    views: Indices
    agrees: Bools

    @property
    def support(self) -> int:
        """Number of images that agree."""
        return int(self.agrees.sum())

    @property
    def is_rigid(self) -> bool:
        """Whether the relative pose is constant."""
        return len(self.agrees) >= MIN_COMMON_VIEWS and self.support >= MIN_RIGID_SHARE * len(self.agrees)


@dataclass(frozen=True, eq=False)
class RigidSets(Displayed):
    """Rigidly connected boards.

    Attributes
    ----------
    sets
        (B,) for each board the first board of its set.
    group_from_board
        B poses relative to that board.
    relations
        Relative poses of all pairs of boards that an image shows.
    """

    sets: tuple[int, ...]
    group_from_board: Poses
    relations: tuple[BoardRelation, ...]

    @classmethod
    def independent(cls, count: int) -> Self:
        """Return boards that are not connected."""
        return cls(tuple(range(count)), Poses.identity(count), ())

    def joined(self, a: int, b: int, a_from_b: Pose) -> Self:
        """Return the sets with those of two boards joined; `a_from_b` is the relative pose of these boards."""
        first, second = sorted((self.sets[a], self.sets[b]))
        if first == second:
            return self
        poses = [self.group_from_board.one(k) for k in range(len(self.sets))]
        step = poses[a] @ a_from_b @ poses[b].inverse()  # the set of a from the set of b
        step = step if self.sets[a] == first else step.inverse()
        moved = [step @ pose if own == second else pose for own, pose in zip(self.sets, poses, strict=True)]
        sets = tuple(first if own == second else own for own in self.sets)
        return replace(self, sets=sets, group_from_board=Poses.of(*moved))

    @property
    def is_further(self) -> tuple[bool, ...]:
        """(B,) which boards are not the first of their set: their relative poses are unknowns."""
        return tuple(own != k for k, own in enumerate(self.sets))

    def contradicting(self, observations: RigObservations) -> list[Indices]:
        """Return for each part (V,) the unit of boards whose pose contradicts their set, see `RigObservations`."""
        units = [np.full(len(part), AGREES) for part in observations.parts]
        for relation in self.relations:
            if relation.is_rigid:
                for k, view in zip(relation.parts[~relation.agrees], relation.views[~relation.agrees], strict=True):
                    units[k][view] = observations.unit_of("board", relation.b)
        return units


def rigid_sets(observations: RigObservations, states: Sequence[State], symmetric: Sequence[bool]) -> RigidSets:
    """Determine which boards are rigidly connected, and their relative poses.

    In every image that shows two boards, their relative pose is compared with one on which most images agree, by its
    chi-square for the covariance of both poses. Sets of boards are connected by the maximum spanning tree of the pairs
    whose relative pose is constant. The numbering of a symmetric board is ambiguous, so it is a set of its own.

    Parameters
    ----------
    observations, states
        Views of all cameras, and camera and board poses of each part.
    symmetric
        For each board, whether it looks the same after half a turn.
    """
    count = len(observations.boards)
    relations = _relations(observations, states, symmetric) if count > 1 else []
    rigid = replace(RigidSets.independent(count), relations=tuple(relations))
    for relation in sorted((r for r in relations if r.is_rigid), key=lambda r: -r.support):
        rigid = rigid.joined(relation.a, relation.b, relation.a_from_b)
    return rigid


def _relations(
    observations: RigObservations, states: Sequence[State], symmetric: Sequence[bool]
) -> list[BoardRelation]:
    """Return the relative poses of all pairs of boards that an image shows together."""
    covariances = [
        _pose_covariances(part.observations, state) for part, state in zip(observations.parts, states, strict=True)
    ]
    frames = [observations.frame[part.group] for part in observations.parts]
    found = list[BoardRelation]()
    for a in range(len(observations.boards)):
        for b in range(a + 1, len(observations.boards)):
            if symmetric[a] or symmetric[b]:
                continue
            together = list[tuple[int, int, int, int]]()  # parts and views of both boards in one image
            for i, part_a in enumerate(observations.parts):
                for j, part_b in enumerate(observations.parts):
                    if part_a.camera == part_b.camera and (part_a.board, part_b.board) == (a, b):
                        _, at_a, at_b = np.intersect1d(frames[i], frames[j], return_indices=True)
                        together += [(i, u, j, v) for u, v in zip(at_a.tolist(), at_b.tolist(), strict=True)]
            if together:
                found.append(_relation(a, b, together, states, covariances))
    return found


def _pose_covariances(observations: Observations, state: State) -> Array:
    """Return the covariances (V, 6, 6) of cam_from_board due to corner noise."""
    weights = ResidualWeights.estimate(state, observations)
    normal = Bundle(observations, FreeParameters.none(state.model), weights).linearize(state)
    return weights.sigma**2 * np.asarray(np.linalg.pinv(normal.local, rcond=1e-14, hermitian=True), float)


def _relation(
    a: int,
    b: int,
    together: Sequence[tuple[int, int, int, int]],
    states: Sequence[State],
    covariances: Sequence[Array],
) -> BoardRelation:
    """Return the relative pose of two boards, and which images agree with it."""
    i, u, j, v = np.array(together, np.intp).T
    first, second = _posed(states, covariances, i, u), _posed(states, covariances, j, v)
    relative = first[0].inverse() @ second[0]
    information = np.asarray(np.linalg.pinv(_relative_covariance(*first, *second), rcond=1e-14, hermitian=True), float)
    steps = [relative.steps_from(relative.one(k)) for k in range(len(relative))]
    squares = [squared_distances(step, np.zeros(POSE_DOF), information) for step in steps]
    best = int(np.median(squares, axis=1).argmin())
    mean = robust_mean(steps[best], information, contradiction_limit(MAX_INFLATION))
    squares = squared_distances(steps[best], mean, information)
    inflation = float(np.clip(np.median(squares) / chdtri(POSE_DOF, 0.5), 1.0, MAX_INFLATION))
    agrees = squares <= contradiction_limit(inflation)
    return BoardRelation(a, b, relative.one(best).moved(mean), j, v, agrees)


def _posed(
    states: Sequence[State], covariances: Sequence[Array], parts: Indices, views: Indices
) -> tuple[Poses, Array]:
    """Return cam_from_board and its covariance (I, 6, 6) in some views of some parts."""
    at = list(zip(parts.tolist(), views.tolist(), strict=True))
    poses = Poses.of(*(Pose(states[k].rotations[n], states[k].translations[n]) for k, n in at))
    return poses, np.array([covariances[k][n] for k, n in at])


def _relative_covariance(first: Poses, first_covariance: Array, second: Poses, second_covariance: Array) -> Array:
    """Return the covariance (I, 6, 6) of first^-1 @ second, as steps of `Pose.moved`."""
    back, arm = np.swapaxes(first.rotation, 1, 2), so3.hat(second.translation - first.translation)
    by_first, by_second = np.zeros((len(first), 6, 6)), np.zeros((len(first), 6, 6))
    by_second[:, :3, :3] = by_second[:, 3:, 3:] = back
    by_first[:, :3, :3] = by_first[:, 3:, 3:] = -back
    by_first[:, 3:, :3] = back @ arm
    return by_first @ first_covariance @ np.swapaxes(by_first, 1, 2) + by_second @ second_covariance @ np.swapaxes(
        by_second, 1, 2
    )
