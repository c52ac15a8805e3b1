"""Connection of cameras without a common view by the motion of the rig between boards at rest."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from omnisight.calibration.rigs.hand_eye import HandEye, solve_hand_eye
from omnisight.calibration.rigs.observations import RigObservations
from omnisight.calibration.rigs.poses import Poses
from omnisight.calibration.rigs.relative_poses import MAX_RESIDUAL_RATIO, MIN_AGREEING_SHARE
from omnisight.calibration.rigs.rigid_sets import RigidSets
from omnisight.calibration.state import State

# Angles (radians) between the relation of two boards and that in one image, below which the image always agrees, and
# above which it never does: the pose of one board is known to about a degree.
MIN_ANGLE_RAD, MAX_ANGLE_RAD = np.radians(1.0), np.radians(3.0)


def with_own_boards(observations: RigObservations, components: Sequence[set[int]]) -> RigObservations:
    """Return the observations with a board of its own for each connected part of a rig.

    A single board that no two parts of a rig observe at the same time is several prints of it, one for each part.
    """
    ordered = sorted(components, key=min)
    board_of = {camera: k for k, part in enumerate(ordered) for camera in part}
    names = tuple(
        f"{observations.boards[0]} of {', '.join(observations.names[c] for c in sorted(part))}" for part in ordered
    )
    parts = tuple(replace(part, board=board_of[part.camera]) for part in observations.parts)
    return replace(observations, parts=parts, boards=names)


def connect_by_motion(
    observations: RigObservations, states: Sequence[State], rigid: RigidSets, components: Sequence[set[int]]
) -> RigidSets | None:
    """Connect the boards that the parts of a rig without a common view observe, assuming that they are at rest.

    Parameters
    ----------
    observations, states
        Views of all cameras, and camera and board poses of each part of the observations.
    rigid
        The rigid sets of boards.
    components
        The cameras that common boards connect.

    Returns
    -------
    The rigid sets with those that the parts observe joined; None if the motion does not determine a relative pose that
    the images agree on.
    """
    ordered = sorted(components, key=min)
    connected, remaining = set(ordered[0]), ordered[1:]
    while remaining:
        found = [
            (support, part_a.board, part_b, solution)
            for i, part_a in enumerate(observations.parts)
            for j, part_b in enumerate(observations.parts)
            if part_a.camera in connected and part_b.camera not in connected and part_a.board != part_b.board
            for support, solution in _solved(observations, states, i, j)
        ]
        if not found:
            return None
        _, board, part, solution = max(found, key=lambda item: item[0])
        rigid = rigid.joined(board, part.board, solution.board_a_from_board_b)
        component = next(cameras for cameras in remaining if part.camera in cameras)
        connected |= component
        remaining = [cameras for cameras in remaining if cameras is not component]
    return rigid


def _solved(observations: RigObservations, states: Sequence[State], i: int, j: int) -> Iterator[tuple[int, HandEye]]:
    """Yield the relative poses of the cameras and boards of two parts, and the number of images that agree."""
    first, second = (observations.frame[observations.parts[k].group] for k in (i, j))
    _, at_a, at_b = np.intersect1d(first, second, return_indices=True)
    poses = [Poses(states[k].rotations[v], states[k].translations[v]) for k, v in ((i, at_a), (j, at_b))]
    solution = solve_hand_eye(*poses)
    if solution is None:
        return
    best = float(np.quantile(solution.angles, MIN_AGREEING_SHARE))
    agrees = solution.angles <= np.clip(MAX_RESIDUAL_RATIO * best, MIN_ANGLE_RAD, MAX_ANGLE_RAD)
    if agrees.mean() > 0.5 and best <= MIN_ANGLE_RAD:
        yield int(agrees.sum()), solution
