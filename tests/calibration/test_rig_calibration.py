"""Joint calibration of rigs: convergence, uncertainty and independent solutions."""

import dataclasses

import numpy as np
import pytest
from benchmarks.rig_scenes import SCENES
from scipy.optimize import least_squares

import omnisight as om
from calibration.rig_corners import FISHEYE, pose_errors, rig_scene
from omnisight.calibration.rigs.board_motion import BoardMotion
from omnisight.calibration.rigs.bundle import RigBundle
from omnisight.geometry import rotation as so3

MAX_SIGMAS = 3.0


@pytest.fixture(scope="module")
def stereo():
    """Return a true stereo rig and its calibration."""
    true = rig_scene("stereo", 14)
    return true, om.calibrate_rig(true.observe(np.random.default_rng(2)), FISHEYE)


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) for n in SCENES if n != "stereo"])
def test_every_rig_converges_within_its_uncertainty(name):
    true = rig_scene(name)
    options = om.CalibrateRigOptions() if name == "mixed" else FISHEYE
    calibration = om.calibrate_rig(true.observe(np.random.default_rng(1)), options)
    for camera, angle, length in zip(calibration.rig.names[1:], *pose_errors(calibration.rig, true.rig), strict=True):
        sigma_angle, sigma_length = calibration.sigmas(camera)
        assert angle < MAX_SIGMAS * sigma_angle
        assert length < MAX_SIGMAS * sigma_length
    assert str(calibration.verdict) != "do not use"


def test_outliers_and_noise_leave_the_pose_within_its_uncertainty(stereo):
    true, calibration = stereo
    (angle,), (length,) = pose_errors(calibration.rig, true.rig)
    assert angle < MAX_SIGMAS * calibration.sigmas("right")[0]
    assert length < MAX_SIGMAS * calibration.sigmas("right")[1]
    assert calibration.sigmas("left") == (0.0, 0.0)


def test_the_minimum_is_that_of_an_independent_solver():
    true = rig_scene("stereo", 6)
    observations = true.observe(np.random.default_rng(3), outliers=0.0)
    calibration = om.calibrate_rig(observations, FISHEYE)
    rig, state = calibration.rig, calibration.estimate.state
    problem = calibration.estimate.problem
    sigmas = [weights.sigma for weights in problem.weights]
    used = sorted({int(g) for part in problem.observations.parts for g in part.group})

    def residuals(x):
        sensor = om.Pose(so3.exp(x[:3]), x[3:6])
        found = []
        for part, camera, pose, sigma in zip(
            problem.observations.parts, rig.cameras, (om.Pose(), sensor), sigmas, strict=True
        ):
            o = part.observations
            for view, group in enumerate(part.group):
                at = x[6 + 6 * used.index(group) :][:6]
                board = om.Pose(so3.exp(at[:3]), at[3:6])
                pixels, _ = camera.project(pose @ (board @ o.points[o.groups[view]]))
                found.append((pixels - o.pixels[o.groups[view]]) / sigma)
        return np.concatenate(found).ravel()

    start = [np.concatenate([so3.log(p.rotation), p.translation]) for p in rig.sensor_from_rig[1:]]
    start += [np.append(so3.log(state.rig_from_group.rotation[g]), state.rig_from_group.translation[g]) for g in used]
    moved = np.concatenate(start) + 1e-3
    solved = least_squares(residuals, moved, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    pose = rig.sensor_from_rig[1]
    assert np.linalg.norm(so3.log(pose.rotation @ so3.exp(solved[:3]).T)) < 1e-2 * calibration.sigmas("right")[0]
    assert np.linalg.norm(pose.translation - solved[3:6]) < 1e-2 * calibration.sigmas("right")[1]


@pytest.mark.parametrize("is_moving", [False, True], ids=["still board", "moving board"])
def test_the_gradient_is_the_derivative_of_the_cost(stereo, is_moving):
    _, calibration = stereo
    rng = np.random.default_rng(0)
    estimate = calibration.estimate
    observations = estimate.problem.observations
    motion = BoardMotion(0.01, 0.002) if is_moving else None
    free = dataclasses.replace(estimate.problem.free_parameters, time_offsets=True, warps=(True,))
    state = dataclasses.replace(
        estimate.state,
        velocities=rng.normal(0, 0.1, estimate.state.velocities.shape),
        time_offsets=np.array([0.0, 0.01]),
        warps=rng.normal(0, 1e-4, (1, 2)),
        motion=rng.normal(0, 1e-3, (len(observations.exposures[0]), 6)) if is_moving else None,
    )
    weights = tuple(dataclasses.replace(w, threshold=1e9) for w in estimate.problem.weights)
    problem = RigBundle(observations, free, weights, motion)
    if is_moving:
        for _ in range(8):  # the reduced gradient is exact where the motions are optimal
            state = problem.with_best_motion(state)
    normal = problem.linearize(state)
    gradient = np.concatenate([normal.shared_gradient, normal.local_gradient.ravel()])
    plain = dataclasses.replace(problem, motion=None)
    scale = 1e-3 / np.sqrt(np.concatenate([np.diagonal(normal.shared), *(np.diagonal(b) for b in normal.local)]))
    checked = np.flatnonzero(np.isfinite(scale))
    assert len(checked) > free.count
    for k in checked[:: max(len(checked) // 40, 1)]:
        step = np.zeros(len(gradient))
        step[k] = scale[k]
        ahead, behind = (problem.cost(_moved(plain, state, sign * step)) for sign in (1, -1))
        numeric = (ahead - behind) / (2 * scale[k])
        assert numeric == pytest.approx(gradient[k], rel=1e-6, abs=1e-6 / scale[k])


def _moved(problem, state, step):
    """Return the state moved by a step, with the same motions of the board."""
    return dataclasses.replace(problem.move(state, step), motion=state.motion)


@pytest.mark.slow
def test_the_stated_uncertainty_is_that_of_repeated_calibrations():
    true = rig_scene("stereo", 14)
    squares, stated, normalized = [], [], []
    for seed in range(20):
        calibration = om.calibrate_rig(true.observe(np.random.default_rng(seed)), FISHEYE)
        (angle,), (length,) = pose_errors(calibration.rig, true.rig)
        squares.append((angle**2, length**2))
        stated.append(np.square(calibration.sigmas("right")))
        exact = true.rig.sensor_from_rig[1] @ true.rig.sensor_from_rig[0].inverse()
        pose, covariance = calibration.rig.sensor_from_rig[1], calibration.rig.covariance[6:, 6:]
        error = np.append(so3.log(pose.rotation @ exact.rotation.T), pose.translation - exact.translation)
        normalized.append(error @ np.linalg.solve(covariance, error) / 6)
    # The standard error of these ratios is 7 to 14 %.
    assert np.sqrt(np.mean(squares, axis=0) / np.mean(stated, axis=0)) == pytest.approx(1.0, abs=0.3)
    assert np.mean(normalized) == pytest.approx(1.0, abs=0.35)


def test_the_rig_frame_is_that_of_the_reference(stereo):
    true, calibration = stereo
    observations = true.observe(np.random.default_rng(2))
    turned = om.calibrate_rig(observations, dataclasses.replace(FISHEYE, reference="right"))
    assert turned.rig.names == ("left", "right")
    assert turned.rig.sensor_from_rig[1] == om.Pose()
    expected = calibration.rig.sensor_from_rig[1].inverse()
    found = turned.rig.sensor_from_rig[0]
    assert np.linalg.norm(so3.log(found.rotation @ expected.rotation.T)) < 0.1 * calibration.sigmas("right")[0]


def test_known_cameras_are_constant_or_refined(stereo, tmp_path):
    true, _ = stereo
    observations = true.observe(np.random.default_rng(2), outliers=0.0)
    files = []
    for name, camera in zip(true.rig.names, true.rig.cameras, strict=True):
        om.save(camera, tmp_path / f"{name}.json")
        files.append(f"{name}={tmp_path / name}.json")
    held = om.calibrate_rig(observations, om.CalibrateRigOptions(camera=tuple(files), flat=True))
    assert [c.model.params.tolist() for c in held.rig.cameras] == [c.model.params.tolist() for c in true.rig.cameras]
    refined = om.calibrate_rig(
        observations, om.CalibrateRigOptions(camera=tuple(files), refine_cameras=True, flat=True)
    )
    change = refined.rig.cameras[0].model.params - true.rig.cameras[0].model.params
    assert change.any()
    (angle,), _ = pose_errors(held.rig, true.rig)
    assert angle < MAX_SIGMAS * held.sigmas("right")[0]
    assert held.sigmas("right")[0] < refined.sigmas("right")[0]


def test_a_held_camera_that_does_not_fit_its_images_is_named(stereo, tmp_path):
    true, _ = stereo
    observations = true.observe(np.random.default_rng(2))
    left, right = true.rig.cameras
    other = dataclasses.replace(right, model=right.model.with_values({"cx": right.model.cx + 30.0}))
    for name, camera in (("left", left), ("right", other)):
        om.save(camera, tmp_path / f"{name}.json")
    files = tuple(f"{name}={tmp_path / name}.json" for name in ("left", "right"))
    calibration = om.calibrate_rig(observations, om.CalibrateRigOptions(camera=files, flat=True))
    (check,) = (check for check in calibration.verdict.checks if check.name.endswith("given camera"))
    assert check.name == "right: given camera"
    assert str(calibration.verdict.level) == "do not use"
    with pytest.raises(ValueError, match=r"--drop: no camera has an image rigth3.png"):
        om.calibrate_rig(observations, om.CalibrateRigOptions(drop=("rigth3.png",)))


def test_the_rig_file_holds_the_result(stereo, tmp_path):
    _, calibration = stereo
    path = tmp_path / "rig.json"
    om.save(calibration.rig, path)
    again = om.load_rig(path)
    assert again.sensor_from_rig[1].matrix == pytest.approx(calibration.rig.sensor_from_rig[1].matrix, abs=1e-14)
    assert np.array_equal(again.covariance, calibration.rig.covariance)
    assert again.calibration["rms"] == calibration.rms
    assert again.unit == "m"


def test_images_of_corner_files_are_dropped_by_name(tmp_path):
    camera, board = om.perspective((640, 480), 90), om.Checkerboard(9, 6, 0.03)
    rig = om.Rig.from_sensors({"left": (camera, om.Pose()), "right": (camera, om.Pose(translation=[-0.1, 0, 0]))})
    rng = np.random.default_rng(0)
    turns = [so3.exp(rng.uniform(-0.4, 0.4, 3)) for _ in range(6)]
    shown = [(board.points - board.points.mean(0)) @ turn.T + np.array([0.05, 0.0, 0.4]) for turn in turns]
    files = []
    for name, sensor_from_rig in zip(rig.names, rig.sensor_from_rig, strict=True):
        corners = [camera.project(sensor_from_rig @ points)[0] for points in shown]
        corners = np.array(corners) + rng.normal(0, 0.1, (6, len(board.points), 2))
        np.savez(tmp_path / f"{name}.npz", corners=corners, pattern=(9, 6), image_size=camera.size)
        om.save(camera, tmp_path / f"{name}.json")
        files.append(f"{name}={tmp_path / name}.json")
    options = om.CalibrateRigOptions(camera=tuple(files), square="30mm", flat=True, drop=("left-2", "right-5"))
    sources = [tmp_path / f"{name}.npz" for name in rig.names]
    left, right = om.calibrate_rig(sources, options).cameras
    assert left.images == [f"left-{k}" for k in (1, 3, 4, 5, 6)]
    assert right.images == [f"right-{k}" for k in (1, 2, 3, 4, 6)]
    with pytest.raises(ValueError, match=r"--drop: no camera has an image left-7 \(did you mean left-6"):
        om.calibrate_rig(sources, dataclasses.replace(options, drop=("left-7",)))
