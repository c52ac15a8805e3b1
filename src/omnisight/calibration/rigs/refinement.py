"""Robust refinement of a rig: without outliers, and with a model of the motion of the board if it moved."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from omnisight.calibration.rigs.board_motion import BoardMotion
from omnisight.calibration.rigs.bundle import RigBundle, pose_groups, refine_rig
from omnisight.calibration.rigs.consistency import Deviations, deviations
from omnisight.calibration.rigs.observations import RigObservations
from omnisight.calibration.rigs.rig_free_parameters import RigFreeParameters
from omnisight.calibration.rigs.state import RigState
from omnisight.calibration.rigs.velocities import velocities
from omnisight.geometry import rotation as so3
from omnisight.optim.tolerances import COMPARISON_TOLERANCE

Array = NDArray[np.float64]

# Ratio of the squared deviations of the views to those due to corner noise above which the board moved. Of a board at
# rest it was at most 1.8 in 100 simulated rigs.
MIN_MOTION_SCATTER = 2.0
# Rounds in which the standard deviations of the motion are estimated.
MOTION_ROUNDS = 3
# Components of a rotation or translation.
COMPONENTS = 3


def refine_at_rest(
    start: RigState, observations: RigObservations, free_parameters: RigFreeParameters
) -> tuple[RigBundle, RigState]:
    """Refine a rig without outliers and with boards at rest, and return the problem and its minimum.

    Parameters
    ----------
    start, observations, free_parameters
        As in `refine_with_motion`.
    """
    return _without_outliers(_with_velocities(start, observations), observations, free_parameters)


def refine_with_motion(
    start: RigState, observations: RigObservations, together: RigObservations, free_parameters: RigFreeParameters
) -> tuple[RigBundle, RigState]:
    """Refine a rig with a motion of the board in each view, and return the problem and its minimum.

    First only the extrinsics, with the cameras as calibrated alone, which no motion of the board between exposures
    disturbs.

    Parameters
    ----------
    start
        Initial state.
    observations
        Boards and pixels of all cameras; views that contradict the extrinsics are in groups of their own.
    together
        The same with the original groups.
    free_parameters
        What is estimated.
    """
    poses = free_parameters.poses_only()
    state = refine_rig(start, observations, poses, tolerance=COMPARISON_TOLERANCE).state
    state = _with_velocities(state, observations)
    motion, state = _with_motion(state, observations, together, poses, MOTION_ROUNDS)
    state = refine_rig(state, observations, free_parameters, motion=motion, tolerance=COMPARISON_TOLERANCE).state
    motion, state = _with_motion(state, observations, together, poses, 1)
    return _without_outliers(state, observations, free_parameters, motion)


def _without_outliers(
    start: RigState,
    observations: RigObservations,
    free_parameters: RigFreeParameters,
    motion: BoardMotion | None = None,
) -> tuple[RigBundle, RigState]:
    """Refine a rig, remove the outliers, and refine it again; return the problem and its minimum.

    The robust loss bounds the influence of an outlier, but 5 % of them still add half of the variance of the noise.
    """
    state = refine_rig(start, observations, free_parameters, motion=motion, tolerance=COMPARISON_TOLERANCE).state
    state = _with_velocities(state, observations)
    inliers = RigBundle.at(state, observations, free_parameters, motion).without_outliers(state)
    state = refine_rig(state, inliers, free_parameters, motion=motion).state
    return RigBundle.at(state, inliers, free_parameters, motion), state


def _with_motion(
    state: RigState, observations: RigObservations, together: RigObservations, poses: RigFreeParameters, rounds: int
) -> tuple[BoardMotion, RigState]:
    """Estimate the standard deviations of the motion of the board, and refine the extrinsics with them."""
    motion = None
    for _ in range(rounds):
        weights = RigBundle.at(state, observations, poses).weights
        still = pose_groups(replace(state, motion=None), observations, weights)
        problem = RigBundle.at(still, observations, poses)
        motion = estimate_motion(deviations(problem, still, together), problem, still)
        if state.motion is None:
            state = replace(state, motion=np.zeros((len(observations.exposures[0]), 6)))
        state = refine_rig(state, observations, poses, motion=motion, tolerance=COMPARISON_TOLERANCE).state
    assert motion is not None
    return motion, state


def estimate_motion(found: list[Deviations], problem: RigBundle, state: RigState) -> BoardMotion:
    """Estimate the standard deviations of the motion of the boards from the deviations of the cameras.

    The deviation of a camera from k others in a group has the variance of corner noise and (1 + 1/k) times that of the
    motion. The median makes the estimate robust to views that contradict the extrinsics.
    """
    cameras = problem.observations.seen().sum(0)
    pivots = np.zeros((len(problem.observations.groups), 3))
    for part in problem.observations.parts:
        pivots[part.group] = state.pivots[part.board]
    samples = list[tuple[float, float, float, float, float]]()
    for deviation in found:
        if deviation.kind != "camera":
            continue
        sensor = state.sensor_from_rig.one(deviation.index)
        for step, information, group, joined in zip(
            deviation.steps, deviation.information, deviation.groups.tolist(), deviation.joined, strict=True
        ):
            if not joined:
                continue
            arm = sensor.rotation @ (state.rig_from_group.one(group) @ pivots[group])
            covariance = np.linalg.inv(information)
            to_pivot = np.hstack([-so3.hat(arm), np.eye(3)])
            shift = to_pivot @ step
            noise = float(np.trace(covariance[:3, :3])), float(np.trace(to_pivot @ covariance @ to_pivot.T))
            factor = 1 + 1 / max(int(cameras[group]) - 1, 1)
            samples.append((float(step[:3] @ step[:3]), float(shift @ shift), *noise, factor))
    turn, shift, turn_noise, shift_noise, factor = np.array(samples).T
    typical = chdtri(COMPONENTS, 0.5)
    rotation = np.median(turn / factor) / typical - np.median(turn_noise / factor) / COMPONENTS
    translation = np.median(shift / factor) / typical - np.median(shift_noise / factor) / COMPONENTS
    # At least a hundredth of the noise: the inverse must be finite.
    least = 1e-2 * np.median(turn_noise) / COMPONENTS, 1e-2 * np.median(shift_noise) / COMPONENTS
    return BoardMotion(float(np.sqrt(max(rotation, least[0]))), float(np.sqrt(max(translation, least[1]))))


def _with_velocities(state: RigState, observations: RigObservations) -> RigState:
    """Return the state with the velocities of the boards, if their times are known."""
    if observations.seconds is None:
        return state
    used = np.asarray(observations.seen().any(0))
    return replace(state, velocities=velocities(state.rig_from_group, observations.seconds, used))
