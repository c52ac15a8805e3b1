"""Uncertainty of the poses of a rig due to the choice of the camera models."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.candidate import FOLD_TOLERANCE, Candidate
from omnisight.calibration.model_averaging import not_rejected
from omnisight.calibration.rigs.bundle import RigBundle
from omnisight.calibration.rigs.poses import Poses
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
            refined = _with_model(problem, state, camera, candidate)
            poses = zip(range(count), (state.sensor_from_rig.one(k) for k in range(count)), strict=True)
            change = np.concatenate([refined.sensor_from_rig.steps_from(pose)[k] for k, pose in poses])
            covariance += (candidate.probability or 0.0) / total * np.outer(change, change)
    return covariance


def _with_model(problem: RigBundle, state: RigState, camera: int, candidate: Candidate) -> RigState:
    """Return the rig refined with another model of a camera."""
    model, free = candidate.state.model, problem.free_parameters
    directions = list(free.cameras)
    directions[camera] = candidate.free_parameters.directions
    problem = replace(problem, free_parameters=replace(free, cameras=tuple(directions)))
    turn = _frame_rotation(
        state.models[camera],
        model,
        [problem.observations.parts[k].observations.pixels for k in problem.observations.parts_of(camera)],
    )
    models = list(state.models)
    models[camera] = model
    start = _with_turned_frame(replace(state, models=tuple(models)), camera, turn)
    tolerance = FOLD_TOLERANCE * problem.free_parameters.count / problem.scale
    return minimize(problem, start, tolerance=tolerance, scale=problem.scale).state


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
