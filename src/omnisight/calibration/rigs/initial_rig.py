"""Initial extrinsics of a rig: a maximum spanning tree of the cameras that observe boards together."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.rigs.observations import AGREES, RigObservations, RigPart
from omnisight.calibration.rigs.poses import Poses
from omnisight.calibration.rigs.relative_poses import (
    MIN_AGREEING_SHARE,
    Pair,
    PairPose,
    estimate_pair_pose,
)
from omnisight.calibration.rigs.rigid_sets import RigidSets
from omnisight.calibration.rigs.sightings import Sightings, half_turn
from omnisight.calibration.rigs.state import RigState
from omnisight.calibration.state import State
from omnisight.geometry.pose import Pose
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class InitialRig:
    """Initial values of a rig.

    Attributes
    ----------
    observations
        The observations; boards of half-turn symmetry have the same numbers of corners in simultaneous views.
    states
        Camera, board poses and warp of each part alone, with the same numbers of corners.
    state
        Cameras, extrinsics and board poses.
    units
        For each part (V,) the camera that contradicts the extrinsics in a view, or `AGREES`.
    """

    observations: RigObservations
    states: tuple[State, ...]
    state: RigState
    units: tuple[Indices, ...]


def relative_poses(sightings: Sequence[Sightings]) -> dict[Pair, PairPose]:
    """Return the relative pose of each pair of cameras (a, b) that observe a group together."""
    pairs = [(a, b) for a in range(len(sightings)) for b in range(a + 1, len(sightings))]
    found = {pair: estimate_pair_pose(sightings[pair[0]], sightings[pair[1]]) for pair in pairs}
    return {pair: pose for pair, pose in found.items() if pose is not None}


def spanning_tree(pairs: Mapping[Pair, PairPose], cameras: int) -> tuple[list[Pair], list[set[int]]]:
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


def is_reliable(pair: PairPose) -> bool:
    """Return whether enough views agree on the relative pose of a pair."""
    # A view always agrees with the pose that it proposed.
    others = len(pair.groups) - 1
    return others == 0 or pair.support - 1 >= MIN_AGREEING_SHARE * others


def initial_rig(
    observations: RigObservations,
    states: Sequence[State],
    sightings: Sequence[Sightings],
    rigid: RigidSets,
    pairs: Mapping[Pair, PairPose],
    tree: Sequence[Pair],
) -> InitialRig:
    """Return the initial values of a rig of connected cameras.

    Parameters
    ----------
    observations, states
        Views of all cameras, and camera and board poses of each part.
    sightings
        The groups that each camera observes.
    rigid
        The rigid sets of boards.
    pairs, tree
        Relative poses, and the pairs that connect all cameras.
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
        turned_parts.append(replace(part, observations=_turned(part.observations, views)))
        turned_states.append(_turned_state(state, part, views))
    observations = replace(observations, parts=tuple(turned_parts))
    sightings = [own.turned(turns[camera][own.group]) for camera, own in enumerate(sightings)]
    sensors = Poses.of(*(sensor_from_rig[c] for c in range(len(observations.names))))
    groups, contradicts = _group_poses(sightings, sensors, pairs, len(observations.groups))
    cameras, boards = len(observations.names), len(observations.boards)
    warps = {part.board: state.warp for part, state in zip(observations.parts, states, strict=True)}
    middles = {part.board: np.append(part.observations.extent.mean(0), 0.0) for part in observations.parts}
    state = RigState(
        tuple(own.model for own in sightings),
        sensors,
        groups,
        rigid.group_from_board,
        np.array([warps[b] for b in range(boards)]),
        np.zeros(cameras),
        np.zeros((len(observations.groups), 6)),
        np.array([middles[first] for first in rigid.sets]),
    )
    units = tuple(np.where(contradicts[part.camera, part.group], part.camera, AGREES) for part in observations.parts)
    return InitialRig(observations, tuple(turned_states), state, units)


def _turned(observations: Observations, views: Bools) -> Observations:
    """Return the observations with the boards of some views (V,) numbered from the opposite corner."""
    rows = views[observations.view_of_row]
    turned = half_turn(observations) @ observations.points
    return replace(observations, points=np.where(rows[:, None], turned, observations.points))


def _turned_state(state: State, part: RigPart, views: Bools) -> State:
    """Return the state with the poses of boards that are numbered from the opposite corner."""
    poses = Poses(state.rotations, state.translations)
    turned = (poses @ Poses.of(half_turn(part.observations))).where(views, poses)
    return replace(state, rotations=turned.rotation, translations=turned.translation)


def _group_poses(
    sightings: Sequence[Sightings], sensors: Poses, pairs: Mapping[Pair, PairPose], count: int
) -> tuple[Poses, Bools]:
    """Return rig_from_group of every group, and (C, G) which cameras contradict the pose of each group.

    The pose is that of the camera with most agreeing pairs, and of those that of the first camera. Of two
    cameras that contradict each other, the view of the same one therefore always counts as wrong.
    """
    agreeing = np.zeros((len(sightings), len(sightings), count), bool)
    for (a, b), pair in pairs.items():
        if is_reliable(pair):
            agreeing[a, b, pair.groups] = agreeing[b, a, pair.groups] = pair.agrees
    votes = agreeing.sum(1)
    rank, chosen, groups = np.full(count, -1), np.zeros(count, np.intp), Poses.identity(count)
    for camera, own in enumerate(sightings):
        poses = sensors[np.full(len(own), camera)].inverse() @ own.cam_from_group
        better = votes[camera, own.group] > rank[own.group]
        at = own.group[better]
        rank[at], chosen[at] = votes[camera, at], camera
        groups.rotation[at], groups.translation[at] = poses.rotation[better], poses.translation[better]
    every = np.arange(count)
    agrees = np.stack([(chosen == camera) | agreeing[camera, chosen, every] for camera in range(len(sightings))])
    return groups, ~agrees
