"""Initial extrinsics of a rig: a maximum spanning tree of the cameras that observe boards together."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.rigs.observations import RigObservations, RigPart
from omnisight.calibration.rigs.poses import Poses
from omnisight.calibration.rigs.relative_poses import (
    MIN_AGREEING_SHARE,
    Pair,
    RelativePose,
    estimate_relative_pose,
    half_turn,
    turned,
)
from omnisight.calibration.rigs.state import RigState
from omnisight.calibration.state import State
from omnisight.geometry.pose import Pose

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class InitialRig:
    """Initial values of a rig.

    Attributes
    ----------
    observations
        The observations; boards of half-turn symmetry are numbered alike in simultaneous views.
    states
        Camera, board poses and warp of each part alone, with boards numbered alike.
    state
        Cameras, extrinsics and board poses.
    consistent
        For each part (V,) the views that agree with the extrinsics.
    """

    observations: RigObservations
    states: tuple[State, ...]
    state: RigState
    consistent: tuple[Bools, ...]


def relative_poses(
    observations: RigObservations, states: Sequence[State], is_symmetric: bool
) -> dict[Pair, RelativePose]:
    """Return the relative pose of each pair of cameras (a, b) that observe a board together.

    Of several boards, the one that most views agree on is used.

    Parameters
    ----------
    observations
        Views of all cameras.
    states
        Camera and board poses of each part.
    is_symmetric
        Whether boards look the same after half a turn.
    """
    pairs: dict[Pair, RelativePose] = {}
    for i, part_a in enumerate(observations.parts):
        for j, part_b in enumerate(observations.parts):
            if part_a.camera >= part_b.camera or part_a.board != part_b.board:
                continue
            found = estimate_relative_pose(part_a, states[i], part_b, states[j], is_symmetric=is_symmetric)
            pair = part_a.camera, part_b.camera
            if found is not None and (pair not in pairs or found.support > pairs[pair].support):
                pairs[pair] = found
    return pairs


def spanning_tree(pairs: Mapping[Pair, RelativePose], cameras: int) -> tuple[list[Pair], list[set[int]]]:
    """Return the maximum spanning forest of the pairs by agreeing views (Kruskal), and its connected cameras.

    Pairs on which fewer than `MIN_AGREEING_SHARE` of the views agree connect nothing.
    """
    components = [{camera} for camera in range(cameras)]
    tree = list[Pair]()
    for pair in sorted(pairs, key=lambda p: (-pairs[p].support, p)):
        found = pairs[pair]
        a, b = (next(c for c in components if camera in c) for camera in pair)
        if a is not b and is_reliable(found):
            components = [c for c in components if c is not a and c is not b] + [a | b]
            tree.append(pair)
    return tree, components


def is_reliable(pair: RelativePose) -> bool:
    """Return whether enough views agree on the relative pose of a pair."""
    # A view always agrees with the pose that it proposed.
    others = len(pair.groups) - 1
    return others == 0 or pair.support - 1 >= MIN_AGREEING_SHARE * others


def initial_rig(
    observations: RigObservations,
    states: Sequence[State],
    pairs: Mapping[Pair, RelativePose],
    tree: Sequence[Pair],
    group_from_board: Sequence[Pose] = (Pose(),),
) -> InitialRig:
    """Return the initial values of a rig of connected cameras.

    Parameters
    ----------
    observations
        Views of all cameras.
    states
        Camera and board poses of each part.
    pairs, tree
        Relative poses, and the pairs that connect all cameras.
    group_from_board
        For each board its pose relative to the first.
    """
    sensor_from_rig = {0: Pose()}
    turns = {0: np.zeros(len(observations.groups), bool)}
    remaining = list(tree)
    while remaining:
        a, b = next(pair for pair in remaining if (pair[0] in sensor_from_rig) != (pair[1] in sensor_from_rig))
        remaining.remove((a, b))
        found = pairs[a, b]
        known, new, step = (a, b, found.b_from_a) if a in sensor_from_rig else (b, a, found.b_from_a.inverse())
        sensor_from_rig[new] = step @ sensor_from_rig[known]
        # A view that no tree path numbers keeps its own numbering.
        turns[new] = np.zeros(len(observations.groups), bool)
        turns[new][found.groups] = turns[known][found.groups] ^ found.turned
    turned_parts, turned_states = list[RigPart](), list[State]()
    for part, state in zip(observations.parts, states, strict=True):
        views = turns[part.camera][part.group]
        changed = turned(part.observations, views)
        turned_parts.append(replace(part, observations=changed))
        turned_states.append(_turned_state(state, part, views))
    observations = replace(observations, parts=tuple(turned_parts))
    sensors = Poses.of(*(sensor_from_rig[c] for c in range(len(observations.names))))
    boards = Poses.of(*group_from_board)
    groups, consistent = _group_poses(observations, turned_states, sensors, boards, pairs)
    first = {part.camera: state.model for part, state in zip(observations.parts, states, strict=True)}
    warps = {part.board: state.warp for part, state in zip(observations.parts, states, strict=True)}
    state = RigState(
        tuple(first[c] for c in range(len(observations.names))),
        sensors,
        groups,
        boards,
        np.array([warps[b] for b in range(observations.boards)]),
        np.zeros(len(observations.names)),
        np.zeros((len(observations.groups), 6)),
    )
    return InitialRig(observations, tuple(turned_states), state, consistent)


def _turned_state(state: State, part: RigPart, views: Bools) -> State:
    """Return the state with the poses of boards that are numbered from the opposite corner."""
    poses = Poses(state.rotations, state.translations)
    other = poses @ Poses.of(half_turn(part.observations))
    return replace(
        state,
        rotations=np.where(views[:, None, None], other.rotation, poses.rotation),
        translations=np.where(views[:, None], other.translation, poses.translation),
    )


def _group_poses(
    observations: RigObservations,
    states: Sequence[State],
    sensors: Poses,
    boards: Poses,
    pairs: Mapping[Pair, RelativePose],
) -> tuple[Poses, tuple[Bools, ...]]:
    """Return rig_from_group of every group, and which views agree with the pose of their group.

    The pose is that of the view with most agreeing pairs, and of those that of the first camera, so that of two cameras
    that contradict each other it is always the same one whose view counts as wrong.
    """
    count = len(observations.groups)
    agreeing = np.zeros((len(observations.names), len(observations.names), count), bool)
    for (a, b), pair in pairs.items():
        if is_reliable(pair):
            agreeing[a, b, pair.groups] = agreeing[b, a, pair.groups] = pair.agrees
    votes = agreeing.sum(1)
    rank = np.full(count, -1)
    chosen = np.zeros(count, np.intp)
    rotations, translations = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
    for part, state in sorted(zip(observations.parts, states, strict=True), key=lambda pair: pair[0].camera):
        sensor, board = (p[np.full(len(part), k)] for p, k in ((sensors, part.camera), (boards, part.board)))
        poses = sensor.inverse() @ Poses(state.rotations, state.translations) @ board.inverse()
        own = votes[part.camera, part.group]
        better = own > rank[part.group]
        groups = part.group[better]
        rank[groups], chosen[groups] = own[better], part.camera
        rotations[groups], translations[groups] = poses.rotation[better], poses.translation[better]
    consistent = tuple(
        (chosen[part.group] == part.camera) | agreeing[part.camera, chosen[part.group], part.group]
        for part in observations.parts
    )
    return Poses(rotations, translations), consistent
