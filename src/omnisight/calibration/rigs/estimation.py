"""Estimation of a rig from calibrated cameras and the boards that they observe."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.rigs.bundle import RigBundle
from omnisight.calibration.rigs.consistency import (
    CameraMove,
    Deviations,
    contradicts,
    deviations,
    find_move,
    scatter,
)
from omnisight.calibration.rigs.covariance import RigCovariance, rig_covariance
from omnisight.calibration.rigs.initial_rig import initial_rig, relative_poses, spanning_tree
from omnisight.calibration.rigs.no_overlap import connect_by_motion
from omnisight.calibration.rigs.observations import RigObservations
from omnisight.calibration.rigs.poses import Poses
from omnisight.calibration.rigs.refinement import refine_robustly
from omnisight.calibration.rigs.relative_poses import Pair, RelativePose
from omnisight.calibration.rigs.rig_free_parameters import RigFreeParameters
from omnisight.calibration.rigs.state import RigState
from omnisight.calibration.state import State
from omnisight.geometry.pose import Pose

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

# Standard deviations above which a time offset is significant.
OFFSET_SIGMAS = 3.0
# Rounds in which views that contradict the extrinsics are removed, or used again.
MAX_CONSISTENCY_ROUNDS = 4


class Unconnected(ValueError):
    """Cameras that no common board connects.

    Attributes
    ----------
    components
        Names of the cameras of each connected part of the rig.
    pairs
        Relative poses by pair of cameras.
    """

    def __init__(self, components: Sequence[Sequence[str]], pairs: Mapping[Pair, RelativePose]) -> None:
        self.components, self.pairs = components, pairs
        parts = "; ".join(", ".join(names) for names in components)
        super().__init__(f"no common board connects these parts of the rig: {parts}")


@dataclass(frozen=True, eq=False)
class RigEstimate:
    """An estimated rig.

    Attributes
    ----------
    observations
        Views of all cameras; those that contradict the extrinsics are in groups of their own.
    together
        Views of all cameras with their original groups.
    problem, state
        The least-squares problem, without outliers, and its minimum.
    covariance
        Covariance of the estimates.
    pairs, tree
        Initial relative poses of all pairs of cameras, and the pairs that connected the rig.
    deviations
        Deviation of each view of cameras that observe boards together.
    inflation
        Ratio of squared deviations to those of corner noise.
    move
        A camera that moved between two images, if any did.
    """

    observations: RigObservations
    together: RigObservations
    problem: RigBundle
    state: RigState
    covariance: RigCovariance
    pairs: Mapping[Pair, RelativePose]
    tree: tuple[Pair, ...]
    deviations: list[Deviations]
    inflation: float
    move: CameraMove | None

    @property
    def consistent(self) -> list[Bools]:
        """For each part (V,) which views agree with the extrinsics."""
        return [
            part.group == original.group
            for part, original in zip(self.observations.parts, self.together.parts, strict=True)
        ]

    @property
    def time_offset_sigmas(self) -> Array:
        """(C,) standard deviations of the time offsets, s; 0 for the first camera, and if they are not estimated."""
        columns = [self.problem.free_parameters.columns("time", c, 1) for c in range(len(self.state.models))]
        variances = np.diagonal(self.covariance.shared)
        return np.array([np.sqrt(variances[c[0]]) if len(c) else 0.0 for c in columns])

    @property
    def has_time_offsets(self) -> bool:
        """Whether the time offset of a camera is significant."""
        return bool((abs(self.state.time_offsets) > OFFSET_SIGMAS * self.time_offset_sigmas).any())


def estimate_rig(
    observations: RigObservations,
    states: Sequence[State],
    free_parameters: RigFreeParameters,
    *,
    is_symmetric: bool = False,
) -> RigEstimate:
    """Estimate a rig from boards that its cameras observe.

    Parameters
    ----------
    observations
        Views of all cameras.
    states
        Camera, board poses and warp of each part, calibrated alone.
    free_parameters
        What is estimated.
    is_symmetric
        Whether boards look the same after half a turn.

    Raises
    ------
    Unconnected
        If no common board connects all cameras.
    """
    pairs = relative_poses(observations, states, is_symmetric)
    tree, components = spanning_tree(pairs, len(observations.names))
    boards = (Pose(),)
    if len(components) > 1:
        connection = connect_by_motion(observations, states, pairs, tree, components)
        if connection is None:
            raise Unconnected([[observations.names[c] for c in sorted(part)] for part in components], pairs)
        observations, pairs, tree = connection.observations, connection.pairs, connection.tree
        boards = connection.group_from_board
        free_parameters = replace(free_parameters, warps=free_parameters.warps[:1] * len(boards), boards=True)
    initial = initial_rig(observations, states, pairs, tree, boards)
    together, consistent, state = initial.observations, list(initial.consistent), initial.state
    rounds = 0
    while True:
        split, rounds = together.split(consistent), rounds + 1
        start = _with_own_groups(state, together, split, initial.states)
        problem, state = refine_robustly(start, split, together, free_parameters)
        found = deviations(problem, state, together)
        inflation = scatter(found)
        before, consistent = consistent, _consistent_views(together, consistent, found, inflation)
        unchanged = all(np.array_equal(a, b) for a, b in zip(before, consistent, strict=True))
        if unchanged or rounds == MAX_CONSISTENCY_ROUNDS:
            break
        state = replace(state.of_groups(np.arange(len(split.groups)) < len(together.groups)), motion=())
    # Motions of the board that are alike in successive images are no independent samples.
    covariance = rig_covariance(problem, state, at_least=inflation if problem.motion else 1.0)
    move = find_move(found, inflation)
    return RigEstimate(split, together, problem, state, covariance, pairs, tuple(tree), found, inflation, move)


def _with_own_groups(
    state: RigState, together: RigObservations, split: RigObservations, states: Sequence[State]
) -> RigState:
    """Return the state with the poses of the groups that single views have of their own."""
    extra = len(split.groups) - len(together.groups)
    poses = Poses.identity(extra)
    for part, original, own in zip(split.parts, together.parts, states, strict=True):
        alone = np.flatnonzero(part.group != original.group)
        if not len(alone):
            continue
        one = np.full(len(alone), part.camera), np.full(len(alone), part.board)
        cam_from_board = Poses(own.rotations[alone], own.translations[alone])
        posed = state.sensor_from_rig[one[0]].inverse() @ cam_from_board @ state.group_from_board[one[1]].inverse()
        rows = part.group[alone] - len(together.groups)
        poses.rotation[rows], poses.translation[rows] = posed.rotation, posed.translation
    groups = Poses(
        np.concatenate([state.rig_from_group.rotation, poses.rotation]),
        np.concatenate([state.rig_from_group.translation, poses.translation]),
    )
    velocities = np.concatenate([state.velocities, np.zeros((extra, 6))])
    return replace(state, rig_from_group=groups, velocities=velocities)


def _consistent_views(
    together: RigObservations, before: Sequence[Bools], found: Sequence[Deviations], inflation: float
) -> list[Bools]:
    """Return for each part (V,) which views agree with the extrinsics.

    Of the views of a group that contradict, only the worst is removed at a time: it makes the others contradict too.
    Of two views, it is that of the last camera.
    """
    worst: dict[int, tuple[float, int]] = {}
    wrong = dict[tuple[int, int], bool]()
    count = np.zeros(len(together.groups), int)
    for part, kept in zip(together.parts, before, strict=True):
        np.add.at(count, part.group[kept], 1)
    for deviation in found:
        views = zip(
            deviation.groups.tolist(),
            deviation.joined,
            deviation.chi_square,
            contradicts(deviation, inflation),
            strict=True,
        )
        for group, joined, square, is_wrong in views:
            wrong[deviation.camera, group] = bool(is_wrong)
            if is_wrong and joined:
                is_pair = count[group] == 2
                worst[group] = max(worst.get(group, (-1.0, -1)), (0.0 if is_pair else float(square), deviation.camera))
    kept = list[Bools]()
    for part, agreed in zip(together.parts, before, strict=True):
        views = [
            worst.get(g, (0.0, -1))[1] != part.camera if was else not wrong.get((part.camera, g), True)
            for g, was in zip(part.group.tolist(), agreed, strict=True)
        ]
        kept.append(np.array(views, bool))
    return kept
