"""Estimation of a rig from calibrated cameras and the boards that they observe."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.rigs.bundle import RigBundle
from omnisight.calibration.rigs.consistency import (
    Deviations,
    Move,
    contradicting_units,
    deviations,
    find_move,
    scatter,
    with_moved_unit,
)
from omnisight.calibration.rigs.covariance import RigCovariance, rig_covariance
from omnisight.calibration.rigs.initial_rig import InitialRig, initial_rig, relative_poses, spanning_tree
from omnisight.calibration.rigs.mirror_images import find_mirrored_pairs, mirrored_cameras
from omnisight.calibration.rigs.no_overlap import connect_by_motion, with_own_boards
from omnisight.calibration.rigs.observations import AGREES, RigObservations
from omnisight.calibration.rigs.poses import Poses
from omnisight.calibration.rigs.refinement import MIN_MOTION_SCATTER, refine_at_rest, refine_with_motion
from omnisight.calibration.rigs.relative_poses import Pair, PairPose
from omnisight.calibration.rigs.rig_free_parameters import RigFreeParameters
from omnisight.calibration.rigs.rigid_sets import RigidSets, rigid_sets
from omnisight.calibration.rigs.sightings import Sightings
from omnisight.calibration.rigs.state import RigState
from omnisight.calibration.state import State
from omnisight.display import Displayed

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.intp]

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
    observations
        Views of all cameras.
    pairs
        Relative poses by pair of cameras.
    mirrored
        Cameras whose images are mirrored; of a pair both, if it could be either.
    """

    def __init__(
        self,
        components: Sequence[Sequence[str]],
        observations: RigObservations,
        pairs: Mapping[Pair, PairPose],
        mirrored: Sequence[int],
    ) -> None:
        self.components, self.observations, self.pairs, self.mirrored = components, observations, pairs, mirrored
        parts = "; ".join(", ".join(names) for names in components)
        super().__init__(f"no common board connects these parts of the rig: {parts}")


@dataclass(frozen=True, eq=False)
class RigEstimate(Displayed):
    """An estimated rig.

    Attributes
    ----------
    observations
        Views of all cameras; those that contradict the extrinsics are in groups of their own.
    together
        Views of all cameras with their original groups.
    rigid
        Which boards are rigidly connected.
    problem, state
        The least-squares problem, without outliers, and its minimum.
    covariance
        Covariance of the estimates.
    pairs, tree
        Initial relative poses of all pairs of cameras, and the pairs that connected the rig.
    deviations
        Deviations of the cameras and boards that share groups with others.
    inflation
        Ratio of squared deviations to those of corner noise.
    move
        A camera or a board that moved between two images, if any did.
    """

    observations: RigObservations
    together: RigObservations
    rigid: RigidSets
    problem: RigBundle
    state: RigState
    covariance: RigCovariance
    pairs: Mapping[Pair, PairPose]
    tree: tuple[Pair, ...]
    deviations: list[Deviations]
    inflation: float
    move: Move | None

    @property
    def consistent(self) -> list[Bools]:
        """For each part (V,) which views agree with the extrinsics."""
        return [
            part.group == original.group
            for part, original in zip(self.observations.parts, self.together.parts, strict=True)
        ]

    def name_of(self, move: Move) -> str:
        """Return the name of the camera or board that moved."""
        return (self.observations.names if move.kind == "camera" else self.observations.boards)[move.index]

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
    symmetric: Sequence[bool],
) -> RigEstimate:
    """Estimate a rig from boards that its cameras observe.

    Parameters
    ----------
    observations
        Views of all cameras; each board of each image is a group of its own.
    states
        Camera, board poses and warp of each part, calibrated alone.
    free_parameters
        What is estimated.
    symmetric
        For each board, whether it looks the same after half a turn.

    Raises
    ------
    Unconnected
        If neither boards nor motion connect all cameras.
    """
    initial, rigid, free_parameters, pairs, tree = _connected(observations, states, free_parameters, symmetric)
    together, units, state = initial.observations, list(initial.units), initial.state
    rounds, moved = 0, None
    while True:
        separated, rounds = together.split(units), rounds + 1
        start = _with_own_groups(state, together, separated, initial.states)
        problem, state = refine_at_rest(start, separated, free_parameters)
        found = deviations(problem, state, together)
        inflation, before = scatter(found), units
        if inflation > MIN_MOTION_SCATTER:
            # One move of a camera is a simpler cause than a motion of the board in each image.
            moved = moved or find_move(found, inflation)
        units = _without_move(together, units, moved)
        if _are_equal(before, units):  # otherwise images on both sides of the move contradict the mean of both poses
            if inflation > MIN_MOTION_SCATTER:
                problem, state = refine_with_motion(start, separated, together, free_parameters)
                found = deviations(problem, state, together)
                inflation = scatter(found)
            units = _without_move(together, contradicting_units(together, units, found, inflation), moved)
        if _are_equal(before, units) or rounds == MAX_CONSISTENCY_ROUNDS:
            break
        original = np.arange(len(separated.groups)) < len(together.groups)
        state = replace(state.of_groups(separated, original), motion=None)
    # Motions of the board that repeat in successive images are not independent samples.
    covariance = rig_covariance(problem, state, at_least=inflation if problem.motion else 1.0)
    move = find_move(found, inflation) or moved
    return RigEstimate(
        separated, together, rigid, problem, state, covariance, pairs, tuple(tree), found, inflation, move
    )


def _without_move(together: RigObservations, units: Sequence[Indices], move: Move | None) -> list[Indices]:
    """Return the units of the views with those on one side of a move separated from their groups."""
    return list(units) if move is None else with_moved_unit(together, units, move)


def _are_equal(units: Sequence[Indices], others: Sequence[Indices]) -> bool:
    """Return whether the same views are separated."""
    return all(np.array_equal(a, b) for a, b in zip(units, others, strict=True))


def _connected(
    observations: RigObservations,
    states: Sequence[State],
    free_parameters: RigFreeParameters,
    symmetric: Sequence[bool],
) -> tuple[InitialRig, RigidSets, RigFreeParameters, Mapping[Pair, PairPose], Sequence[Pair]]:
    """Return the initial values of a rig, and what connects it: by common boards, or else by motion."""
    rigid, warps, cameras = rigid_sets(observations, states, symmetric), free_parameters.warps, len(observations.names)
    grouped, sightings, pairs = _related(observations, states, rigid, symmetric)
    tree, components = spanning_tree(pairs, cameras)
    mirrored = mirrored_cameras(find_mirrored_pairs(sightings))
    if len(components) > 1 or mirrored:
        names = [[observations.names[c] for c in sorted(part)] for part in components]
        unconnected = Unconnected(names, grouped, pairs, mirrored)
        if mirrored:
            raise unconnected
        if len(observations.boards) == 1:
            observations = with_own_boards(observations, components)
            count = len(observations.boards)
            rigid, symmetric, warps = RigidSets.independent(count), tuple(symmetric) * count, warps * count
        joined = connect_by_motion(observations, states, rigid, components)
        if joined is None:
            raise unconnected
        rigid = joined
        grouped, sightings, pairs = _related(observations, states, rigid, symmetric)
        tree, components = spanning_tree(pairs, cameras)
        if len(components) > 1:
            raise unconnected
    free = replace(free_parameters, warps=warps, boards=rigid.is_further)
    initial = initial_rig(grouped, states, sightings, rigid, pairs, tree)
    moved = rigid.contradicting(grouped)
    units = tuple(np.where(board == AGREES, own, board) for own, board in zip(initial.units, moved, strict=True))
    return replace(initial, units=units), rigid, free, pairs, tree


def _related(
    observations: RigObservations, states: Sequence[State], rigid: RigidSets, symmetric: Sequence[bool]
) -> tuple[RigObservations, list[Sightings], dict[Pair, PairPose]]:
    """Return the observations by rigid sets of boards, what each camera sees, and the relative poses of the cameras."""
    grouped = observations.with_rigid_sets(rigid.sets)
    cameras = range(len(observations.names))
    sightings = [Sightings.of(c, grouped, states, rigid.group_from_board, symmetric) for c in cameras]
    return grouped, sightings, relative_poses(sightings)


def _with_own_groups(
    state: RigState, together: RigObservations, separated: RigObservations, states: Sequence[State]
) -> RigState:
    """Return the state with the poses of the groups of separated views."""
    extra = len(separated.groups) - len(together.groups)
    poses, velocities = Poses.identity(extra), np.zeros((extra, 6))
    for part, original, own in zip(separated.parts, together.parts, states, strict=True):
        alone = np.flatnonzero(part.group != original.group)
        if not len(alone):
            continue
        sensor, board = np.full(len(alone), part.camera), np.full(len(alone), part.board)
        cam_from_board = Poses(own.rotations[alone], own.translations[alone])
        posed = state.sensor_from_rig[sensor].inverse() @ cam_from_board @ state.group_from_board[board].inverse()
        rows = part.group[alone] - len(together.groups)
        poses.rotation[rows], poses.translation[rows] = posed.rotation, posed.translation
    groups = Poses(
        np.concatenate([state.rig_from_group.rotation, poses.rotation]),
        np.concatenate([state.rig_from_group.translation, poses.translation]),
    )
    return replace(state, rig_from_group=groups, velocities=np.concatenate([state.velocities, velocities]))
