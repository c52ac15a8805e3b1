"""Uncertainty of the poses of a rig due to the choice of the camera models."""

import dataclasses

import numpy as np
import pytest
from benchmarks.rig_scenes import RigScene, scene
from benchmarks.rig_scenes import stereo as stereo_rig

import omnisight as om
from calibration.rig_corners import FISHEYE, pose_errors, rig_scene
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.rigs.model_uncertainty import model_covariance
from omnisight.geometry import rotation as so3
from omnisight.optim.levenberg_marquardt import minimize

SHIFT_PX, PROBABILITY = 5.0, 0.25


@pytest.fixture(scope="module")
def stereo():
    """Return the calibration of a stereo rig."""
    true = rig_scene("stereo", 14)
    return om.calibrate_rig(true.observe(np.random.default_rng(2)), FISHEYE)


def covariance_with_shifted_camera(calibration, name, fixed=()):
    """Return the covariance if one camera alone may have another principal point too."""
    candidates = []
    for camera in calibration.cameras:
        best = dataclasses.replace(camera.calibration.best, probability=1 - PROBABILITY)
        candidates.append([best])
        if camera.name == name:
            model = best.state.model
            moved = model.with_values({"cx": model.to_dict()["cx"] + SHIFT_PX})
            candidates[-1].append(
                dataclasses.replace(
                    best,
                    name="shifted",
                    state=dataclasses.replace(best.state, model=moved),
                    free_parameters=FreeParameters.of(moved, fixed=fixed),
                    probability=PROBABILITY,
                )
            )
    return model_covariance(calibration.estimate.problem, calibration.estimate.state, candidates)


@pytest.mark.parametrize("camera", ["left", "right"])
def test_a_principal_point_that_common_boards_determine_adds_nothing(stereo, camera):
    added = covariance_with_shifted_camera(stereo, camera)
    stated = np.diag(stereo.estimate.covariance.extrinsics)[6:]
    assert (np.diag(added)[6:] < 0.01 * stated).all()
    assert not added[:6].any()


@pytest.mark.parametrize("camera", [0, 1])
def test_a_model_with_another_principal_point_adds_the_change_of_the_pose(stereo, camera):
    added = covariance_with_shifted_camera(stereo, stereo.rig.names[camera], fixed=("cx",))
    problem, state = stereo.estimate.problem, stereo.estimate.state
    models, directions = list(state.models), list(problem.free_parameters.cameras)
    models[camera] = models[camera].with_values({"cx": stereo.cameras[camera].camera.model.to_dict()["cx"] + SHIFT_PX})
    directions[camera] = FreeParameters.of(models[camera], fixed=("cx",)).directions
    free = dataclasses.replace(problem.free_parameters, cameras=tuple(directions))
    start = dataclasses.replace(state, models=tuple(models))
    refined = minimize(dataclasses.replace(problem, free_parameters=free), start, tolerance=1e-9).state
    change = refined.sensor_from_rig.steps_from(state.sensor_from_rig.one(1))[1]
    assert np.linalg.norm(change[:3]) > 1.5 * stereo.sigmas("right")[0]
    np.testing.assert_allclose(added[6:, 6:], PROBABILITY * np.outer(change, change), rtol=0.1, atol=1e-9)


def test_known_cameras_add_nothing(stereo):
    estimate = stereo.estimate
    assert not model_covariance(estimate.problem, estimate.state, [(), ()]).any()


def decentered_stereo():
    """Return the stereo pair with tangential distortion, which no Kannala-Brandt camera has."""
    rig = stereo_rig()
    cameras = []
    for camera, sign in zip(rig.cameras, (1, -1), strict=True):
        values = camera.model.to_dict() | {"p1": sign * 6e-4, "p2": -8e-4, "s1": 0.0, "s2": 0.0}
        cameras.append(dataclasses.replace(camera, model=om.model_class("thin_prism_fisheye").from_dict(values)))
    return dataclasses.replace(rig, cameras=tuple(cameras))


def test_the_uncertainty_contains_the_error_of_models_that_do_not_fit_the_lenses():
    true = scene(decentered_stereo, 0.03, 20)
    calibration = om.calibrate_rig(true.observe(np.random.default_rng(1), noise_px=0.1), FISHEYE)
    (angle,), (length,) = pose_errors(calibration.rig, true.rig)
    sigmas = calibration.sigmas("right")
    assert angle < 2 * sigmas[0]
    assert length < 2 * sigmas[1]
    reasons = " ".join(calibration.reasons)
    assert "The camera models are not exact" in reasons
    assert "The board moved" not in reasons
    assert str(calibration.verdict) != "good"


def test_a_board_that_moves_is_no_error_of_the_models():
    true, rng = rig_scene("stereo", 14), np.random.default_rng(3)
    observations = {}
    for name in true.rig.names:
        poses = [
            om.Pose(so3.exp(2e-3 * rng.normal(size=3)) @ pose.rotation, pose.translation + 5e-4 * rng.normal(size=3))
            for pose in true.rig_from_board
        ]
        observations[name] = RigScene(true.rig, true.board, poses).observe(rng)[name]
    calibration = om.calibrate_rig(observations, FISHEYE)
    assert calibration.model_error is None
    assert any("The board moved" in reason for reason in calibration.reasons)
