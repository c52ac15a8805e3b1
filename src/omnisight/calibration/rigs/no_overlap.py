"""Connection of cameras without a common view by the motion of the rig between boards at rest."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from omnisight.calibration.rigs.hand_eye import HandEye, solve_hand_eye
from omnisight.calibration.rigs.observations import RigObservations
from omnisight.calibration.rigs.poses import Poses
from omnisight.calibration.rigs.relative_poses import (
    MAX_RESIDUAL_RATIO,
    MIN_AGREEING_SHARE,
    Pair,
    RelativePose,
)
from omnisight.calibration.state import State
from omnisight.geometry.pose import Pose

# Angles (radians) between the relation of two boards and that in one image, below which the image always agrees, and
# above which it never does: the pose of one board is known to about a degree.
MIN_ANGLE_RAD, MAX_ANGLE_RAD = np.radians(1.0), np.radians(3.0)


@dataclass(frozen=True, eq=False)
class Connection:
    """Cameras that are connected by motion.

    Attributes
    ----------
    observations
        The observations; the boards of each connected part of the rig are numbered by the part.
    pairs, tree
        All relative poses, and the pairs that connect all cameras.
    group_from_board
        For each board its pose relative to the first.
    """

    observations: RigObservations
    pairs: Mapping[Pair, RelativePose]
    tree: Sequence[Pair]
    group_from_board: tuple[Pose, ...]


def connect_by_motion(
    observations: RigObservations,
    states: Sequence[State],
    pairs: Mapping[Pair, RelativePose],
    tree: Sequence[Pair],
    components: Sequence[set[int]],
) -> Connection | None:
    """Connect the parts of a rig that share no view, assuming that each observes a board of its own at rest.

    Parameters
    ----------
    observations, states
        Views of all cameras, and camera and board poses of each part of the observations.
    pairs, tree, components
        Relative poses of cameras with a common view, the pairs that connect them, and the cameras they connect.

    Returns
    -------
    None if the motion does not determine a relative pose that the images agree on.
    """
    ordered = sorted(components, key=min)
    board_of = {camera: k for k, part in enumerate(ordered) for camera in part}
    connected, relations = set(ordered[0]), {0: Pose()}
    all_pairs, all_tree = dict(pairs), list(tree)
    for number, component in enumerate(ordered[1:], start=1):
        found = [
            (a, b, edge, solution)
            for a in sorted(connected)
            for b in sorted(component)
            if (solved := _solve(observations, states, a, b)) is not None
            for edge, solution in [solved]
        ]
        if not found:
            return None
        a, b, edge, solution = max(found, key=lambda item: item[2].support)
        relations[number] = relations[board_of[a]] @ solution.board_a_from_board_b
        pair = (a, b) if a < b else (b, a)
        all_pairs[pair] = edge if a < b else replace(edge, b_from_a=edge.b_from_a.inverse())
        all_tree.append(pair)
        connected |= component
    parts = tuple(replace(part, board=board_of[part.camera]) for part in observations.parts)
    boards = tuple(relations[k] for k in range(len(ordered)))
    return Connection(replace(observations, parts=parts), all_pairs, all_tree, boards)


def _solve(
    observations: RigObservations, states: Sequence[State], a: int, b: int
) -> tuple[RelativePose, HandEye] | None:
    """Return the relative pose of two cameras from their motion, and that of their boards."""
    first, second = observations.parts_of(a)[0], observations.parts_of(b)[0]
    part_a, part_b = observations.parts[first], observations.parts[second]
    groups, at_a, at_b = np.intersect1d(part_a.group, part_b.group, return_indices=True)
    poses = [Poses(states[k].rotations[v], states[k].translations[v]) for k, v in ((first, at_a), (second, at_b))]
    solution = solve_hand_eye(*poses)
    if solution is None:
        return None
    best = float(np.quantile(solution.angles, MIN_AGREEING_SHARE))
    agrees = solution.angles <= np.clip(MAX_RESIDUAL_RATIO * best, MIN_ANGLE_RAD, MAX_ANGLE_RAD)
    if agrees.mean() <= 0.5 or best > MIN_ANGLE_RAD:
        return None
    nothing = np.zeros(len(groups), bool)
    return RelativePose(solution.b_from_a, groups, agrees, nothing, np.full(len(groups), np.nan)), solution
