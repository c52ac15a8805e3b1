"""Uncertainty of the poses of a rig due to the camera models: their choice, and their errors."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.candidate import FOLD_TOLERANCE, Candidate
from omnisight.calibration.model_averaging import not_rejected
from omnisight.calibration.rigs.bundle import RigBundle
from omnisight.calibration.rigs.consistency import deviations, scatter
from omnisight.calibration.rigs.observations import RigObservations
from omnisight.calibration.rigs.poses import Poses
from omnisight.calibration.rigs.refinement import MIN_MOTION_SCATTER
from omnisight.calibration.rigs.state import RigState
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.models import CameraModel, Projector
from omnisight.optim.levenberg_marquardt import minimize

Array = NDArray[np.float64]


def model_covariance(problem: RigBundle, state: RigState, candidates: Sequence[Sequence[Candidate]]) -> Array:
    """Return the covariance (6 C, 6 C) of `sensor_from_rig` due to the choice of the camera models.

    Models that fit the images of a camera equally well can define its axis differently: a shift of the principal point
    resembles a rotation. The boards that several cameras observe exclude most of it, so the rig is refined with each
    model that the images do not reject in place of the selected one. The covariance is the second moment of the change
    of the poses, weighted by the probabilities of the models; those of different cameras add up.

    Parameters
    ----------
    problem, state
        The least-squares problem with the selected models, without outliers, and its minimum.
    candidates
        For each camera the models fitted to its images alone, the selected one first; none if it is known.
    """
    count = len(state.models)
    covariance = np.zeros((6 * count, 6 * count))
    for camera, fitted in enumerate(candidates):
        total = sum(candidate.probability or 0.0 for candidate in not_rejected(fitted))
        for candidate in not_rejected(fitted[1:]):
            change = _change(state, _with_models(problem, state, {camera: candidate})[1]).ravel()
            covariance += (candidate.probability or 0.0) / total * np.outer(change, change)
    return covariance


def model_error(
    problem: RigBundle, state: RigState, together: RigObservations, splines: Mapping[int, Candidate]
) -> Array | None:
    """Return the change (C, 6) of `sensor_from_rig`, in steps, if the cameras are splines and the boards at rest.

    Errors of the camera models move the boards differently in each camera, as a motion between the exposures does. But
    they are common to all images, so that neither the motion nor the scatter between images contains their effect on
    the extrinsics. Splines fit any lens, and no motion: if the boards of the rig with splines agree, the models are the
    cause, and the change is their effect. The result is None if the boards do not agree.

    Parameters
    ----------
    problem, state
        The least-squares problem with the selected models, without outliers, and its minimum.
    together
        The observations with the original groups.
    splines
        The spline of each camera that has one.
    """
    at_rest = replace(problem, motion=None)
    refined_problem, refined = _with_models(at_rest, replace(state, motion=None), splines)
    if scatter(deviations(refined_problem, refined, together)) > MIN_MOTION_SCATTER:
        return None
    return _change(state, refined)


def _change(state: RigState, refined: RigState) -> Array:
    """Return the steps (C, 6) from the poses of a rig to those of another one."""
    poses = (state.sensor_from_rig.one(k) for k in range(len(state.models)))
    return np.stack([refined.sensor_from_rig.steps_from(pose)[k] for k, pose in enumerate(poses)])


def _with_models(
    problem: RigBundle, state: RigState, candidates: Mapping[int, Candidate]
) -> tuple[RigBundle, RigState]:
    """Return the problem with other models of some cameras, and the rig refined with them."""
    directions = list(problem.free_parameters.cameras)
    start = state
    for camera, candidate in candidates.items():
        directions[camera] = candidate.free_parameters.directions
        start = _with_model(problem, start, camera, candidate.state.model)
    problem = replace(problem, free_parameters=replace(problem.free_parameters, cameras=tuple(directions)))
    tolerance = FOLD_TOLERANCE * problem.free_parameters.count / problem.scale
    return problem, minimize(problem, start, tolerance=tolerance, scale=problem.scale).state


def _with_model(problem: RigBundle, state: RigState, camera: int, model: Projector) -> RigState:
    """Return the state with another model of a camera, whose frame is aligned with that of the selected one."""
    turn = _frame_rotation(
        state.models[camera],
        model,
        [problem.observations.parts[k].observations.pixels for k in problem.observations.parts_of(camera)],
    )
    models = list(state.models)
    models[camera] = model
    return _with_turned_frame(replace(state, models=tuple(models)), camera, turn)


def _frame_rotation(model: Projector, other: Projector, pixels: Sequence[Array]) -> Array:
    """Return the rotation (3, 3) that aligns the bearings of a model with those of another one (Kabsch 1976)."""
    if not isinstance(model, CameraModel) or not isinstance(other, CameraModel):
        return np.eye(3)
    (bearings, seen), (others, valid) = (m.unproject_numpy(np.concatenate(pixels)) for m in (model, other))
    both = seen & valid
    return so3.nearest(others[both].T @ bearings[both])


def _with_turned_frame(state: RigState, camera: int, turn: Array) -> RigState:
    """Return the state with the frame of a camera rotated about the camera; that of the first one is the rig frame."""
    turned = Poses.of(Pose(turn))
    poses = Poses(state.sensor_from_rig.rotation.copy(), state.sensor_from_rig.translation.copy())
    if camera == 0:
        poses.rotation[1:] @= turn.T
        return replace(state, sensor_from_rig=poses, rig_from_group=turned @ state.rig_from_group)
    moved = turned @ poses[np.array([camera])]
    poses.rotation[camera], poses.translation[camera] = moved.rotation[0], moved.translation[0]
    return replace(state, sensor_from_rig=poses)
