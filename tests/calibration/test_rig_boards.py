"""Rigs that see several boards at once: boards at rest relative to each other, and boards that move."""

import dataclasses

import numpy as np
import pytest
from benchmarks.rig_scenes import visible

import omnisight as om
from calibration.rig_corners import FISHEYE, pose_errors, rig_scene
from omnisight.geometry import rotation as so3

BOARD = om.Checkerboard(9, 6, 0.03)
MIDDLE = BOARD.points.mean(0)
# A margin of three quarters of a square on two sides: the board does not look the same after half a turn.
EXTENT = BOARD.points[:, :2].min(0) - 0.0225, BOARD.points[:, :2].max(0)
MAX_SIGMAS = 3.0


def observe(rig, boards, noise=0.3, seed=0):
    """Return what each camera sees of boards at poses rig_from_board, a list for each board by image."""
    rng, found = np.random.default_rng(seed), {}
    for name, camera, sensor in zip(rig.names, rig.cameras, rig.sensor_from_rig, strict=True):
        found[name] = {}
        for board, poses in boards.items():
            views = [(k, *visible(camera, sensor @ pose, BOARD)) for k, pose in enumerate(poses)]
            views = [(k, ids, at) for k, ids, at in views if len(ids) >= 12]
            if not views:
                continue
            found[name][board] = om.Observations.from_arrays(
                [BOARD.points[ids] for _, ids, _ in views],
                [at + rng.normal(0, noise, at.shape) for _, _, at in views],
                size=camera.size,
                names=[f"{k:04d}.png" for k, _, _ in views],
                extent=EXTENT,
                unit="m",
            )
    return found


def facing(direction, distance, rng):
    """Return world_from_board of a board in a direction that faces the origin."""
    z = np.array(direction, float) / np.linalg.norm(direction)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    rotation = np.column_stack([x, np.cross(z, x), z]) @ so3.exp(rng.uniform(-0.2, 0.2, 3))
    return om.Pose(rotation, distance * z - rotation @ MIDDLE)


def back_to_back():
    """Return two fisheyes of 120 degrees without a common view."""
    camera = rig_scene("chain", 4).rig.cameras[0]
    back = om.look(180.0, 4.0)
    return om.Rig.from_sensors(
        {"front": (camera, om.Pose()), "back": (camera, om.Pose(back, -back @ np.array([0.04, 0.01, -0.08])))}
    )


def room(rng, count=8):
    """Return world_from_board of boards all around."""
    angles = 2 * np.pi * np.arange(count) / count
    return {f"wall{k}": facing((np.sin(a), 0.1 * (-1) ** k, np.cos(a)), 0.42, rng) for k, a in enumerate(angles)}


def turning(rng, count):
    """Return rig_from_world of a rig that turns in the middle of a room."""
    return [
        om.Pose(so3.exp(rng.uniform(-0.25, 0.25, 3)) @ om.look(rng.uniform(-180, 180)), rng.uniform(-0.06, 0.06, 3))
        for _ in range(count)
    ]


def in_room(rig, count, rng, noise=0.3, seed=0):
    """Return what a rig sees that turns in a room of boards at rest."""
    walls, poses = room(rng), turning(rng, count)
    return observe(rig, {name: [p @ board for p in poses] for name, board in walls.items()}, noise, seed)


def assert_within_uncertainty(calibration, true):
    for name, angle, length in zip(calibration.rig.names[1:], *pose_errors(calibration.rig, true), strict=True):
        assert angle < MAX_SIGMAS * calibration.sigmas(name)[0]
        assert length < MAX_SIGMAS * calibration.sigmas(name)[1]


@pytest.fixture
def known(tmp_path):
    """Return the options with which all cameras of a rig are known."""

    def options(rig, **others):
        for name, camera in zip(rig.names, rig.cameras, strict=True):
            om.save(camera, tmp_path / f"{name}.json")
        files = tuple(f"{name}={tmp_path / name}.json" for name in rig.names)
        return om.CalibrateRigOptions(camera=files, flat=True, **others)

    return options


def hand_held(rng, count):
    """Return poses of a board in a hand in front of two cameras."""
    rotations = [so3.exp(rng.uniform(-0.5, 0.5, 3)) for _ in range(count)]
    middles = [np.append(rng.uniform(-0.12, 0.12, 2), rng.uniform(0.4, 0.55)) for _ in range(count)]
    return [om.Pose(r, middle - r @ MIDDLE) for r, middle in zip(rotations, middles, strict=True)]


BESIDE = om.Pose(so3.exp([0.3, 0.1, 0.05]), np.array([0.29, 0.02, -0.03]))


def test_boards_at_rest_connect_cameras_without_a_common_view(known):
    rig = back_to_back()
    calibration = om.calibrate_rig(in_room(rig, 24, np.random.default_rng(1)), known(rig))
    assert set(calibration.estimate.rigid.sets) == {0}
    assert calibration.pairs[0].agreeing == calibration.pairs[0].shared
    assert_within_uncertainty(calibration, rig)
    assert calibration.sigmas("back")[1] < 0.0005


def test_parallel_prints_of_a_board_at_opposite_walls_are_no_mirror_images(known):
    rng, camera, back = np.random.default_rng(4), rig_scene("chain", 4).rig.cameras[0], om.look(180.0)
    rig = om.Rig.from_sensors({"front": (camera, om.Pose()), "back": (camera, om.Pose(back, [0.0, 0.0, -0.16]))})
    poses = [om.Pose(so3.exp(rng.normal(0, 0.25, 3)), rng.normal(0, 0.04, 3)) for _ in range(16)]
    walls = {"front": om.Pose(np.eye(3), [0, 0, 0.35] - MIDDLE), "back": om.Pose(back, [0, 0, -0.35] - back @ MIDDLE)}
    prints = {
        name: observe(rig.subset([name]), {"board": [p @ wall for p in poses]})[name]["board"]
        for name, wall in walls.items()
    }
    assert_within_uncertainty(om.calibrate_rig(prints, known(rig)), rig)


@pytest.mark.slow
def test_cameras_are_calibrated_from_several_boards():
    rig, observations = back_to_back(), in_room(back_to_back(), 20, np.random.default_rng(1))
    unseen = observations["front"]["wall0"].subset([])
    calibration = om.calibrate_rig(observations | {"back": {"floor": unseen, **observations["back"]}}, FISHEYE)
    assert set(calibration.estimate.rigid.sets) == {0}
    assert_within_uncertainty(calibration, rig)


@pytest.mark.slow
def test_the_stated_uncertainty_of_several_boards_is_that_of_repeated_calibrations(known):
    rig, squares, stated = back_to_back(), [], []
    for seed in range(20):
        observations = in_room(rig, 10, np.random.default_rng(1), seed=seed)
        calibration = om.calibrate_rig(observations, known(rig))
        (angle,), (length,) = pose_errors(calibration.rig, rig)
        squares.append((angle**2, length**2))
        stated.append(np.square(calibration.sigmas("back")))
    # The standard error of these ratios is 7 to 14 %.
    assert np.sqrt(np.mean(squares, axis=0) / np.mean(stated, axis=0)) == pytest.approx(1.0, abs=0.3)


def test_the_poses_of_boards_at_rest_are_estimated(known):
    rig, rng = rig_scene("stereo", 4).rig, np.random.default_rng(2)
    poses = hand_held(rng, 14)
    boards = {"a": poses, "b": [pose @ BESIDE for pose in poses]}
    calibration = om.calibrate_rig(observe(rig, boards), known(rig))
    state = calibration.estimate.state
    assert calibration.estimate.rigid.sets == (0, 0)
    step = om.Pose(state.group_from_board.rotation[1] @ BESIDE.rotation.T, np.zeros(3))
    assert np.linalg.norm(so3.log(step.rotation)) < 2e-3
    assert state.group_from_board.translation[1] == pytest.approx(BESIDE.translation, abs=5e-4)
    alone = om.calibrate_rig(observe(rig, {"a": poses}), known(rig))
    assert calibration.sigmas("right")[0] < 0.85 * alone.sigmas("right")[0]
    assert_within_uncertainty(calibration, rig)


def test_boards_that_move_are_independent(known):
    rig, rng = rig_scene("stereo", 4).rig, np.random.default_rng(2)
    boards = {"a": hand_held(rng, 14), "b": [pose @ BESIDE for pose in hand_held(rng, 14)]}
    calibration = om.calibrate_rig(observe(rig, boards), known(rig))
    assert calibration.estimate.rigid.sets == (0, 1)
    (pair,) = calibration.pairs
    assert pair.agreeing == pair.shared == 14
    assert_within_uncertainty(calibration, rig)


def test_a_board_that_moved_in_one_image_contradicts_it_alone(known):
    rig, poses = rig_scene("stereo", 4).rig, hand_held(np.random.default_rng(2), 14)
    beside = [pose @ BESIDE for pose in poses]
    beside[5] = beside[5].moved([0.02, 0.0, 0.01, 0.004, 0.0, 0.003])
    calibration = om.calibrate_rig(observe(rig, {"a": poses, "b": beside}), known(rig))
    estimate = calibration.estimate
    wrong = [
        (estimate.observations.boards[part.board], part.observations.names[v])
        for part, kept in zip(estimate.observations.parts, estimate.consistent, strict=True)
        for v in np.flatnonzero(~kept)
    ]
    assert wrong
    assert {image for _, image in wrong} == {"0005.png"}
    assert len({board for board, _ in wrong}) == 1
    assert_within_uncertainty(calibration, rig)


def test_a_board_that_was_moved_is_named_with_its_images(known):
    rig, poses = rig_scene("stereo", 4).rig, hand_held(np.random.default_rng(2), 20)
    moved = BESIDE.moved([0.01, 0.0, 0.0, 0.004, 0.0, 0.0])
    beside = [pose @ (BESIDE if k < 15 else moved) for k, pose in enumerate(poses)]
    calibration = om.calibrate_rig(observe(rig, {"near": poses, "far": beside}), known(rig))
    move = calibration.estimate.move
    assert (move.kind, move.before, move.after) == ("board", "0014.png", "0015.png")
    assert move.angle == pytest.approx(0.01, rel=0.3)
    assert any("relative to the other boards between 0014.png and 0015.png" in r for r in calibration.reasons)
    assert_within_uncertainty(calibration, rig)


def test_the_gradient_for_several_boards_is_the_derivative_of_the_cost(known):
    rig = back_to_back()
    estimate = om.calibrate_rig(in_room(rig, 8, np.random.default_rng(3)), known(rig)).estimate
    rng, problem = np.random.default_rng(0), estimate.problem
    weights = tuple(dataclasses.replace(w, threshold=1e9) for w in problem.weights)
    free = dataclasses.replace(problem.free_parameters, warps=(True,) * len(problem.observations.boards))
    problem = dataclasses.replace(problem, weights=weights, free_parameters=free)
    state = dataclasses.replace(estimate.state, warps=rng.normal(0, 1e-4, estimate.state.warps.shape))
    normal = problem.linearize(state)
    gradient = np.concatenate([normal.shared_gradient, normal.local_gradient.ravel()])
    scale = 1e-3 / np.sqrt(np.concatenate([np.diagonal(normal.shared), *(np.diagonal(b) for b in normal.local)]))
    checked = np.flatnonzero(np.isfinite(scale))
    assert len(checked) > free.count
    for k in checked[:: max(len(checked) // 60, 1)]:
        step = np.zeros(len(gradient))
        step[k] = scale[k]
        ahead, behind = (problem.cost(problem.move(state, sign * step)) for sign in (1, -1))
        numeric = (ahead - behind) / (2 * scale[k])
        assert numeric == pytest.approx(gradient[k], rel=1e-6, abs=1e-6 / scale[k])


def test_images_to_drop_are_left_out_of_every_board(known):
    rig, poses = rig_scene("stereo", 4).rig, hand_held(np.random.default_rng(2), 8)
    boards = {"a": poses, "b": [pose @ BESIDE for pose in poses]}
    calibration = om.calibrate_rig(observe(rig, boards), known(rig, drop=("0003.png",)))
    assert calibration.cameras
    for camera in calibration.cameras:
        assert sorted(camera.images) == [f"{k:04d}.png" for k in range(8) if k != 3]


def test_a_board_whose_images_are_all_dropped_is_left_out(known):
    rig, poses = rig_scene("stereo", 4).rig, hand_held(np.random.default_rng(2), 8)
    observations = observe(rig, {"a": poses, "b": [pose @ BESIDE for pose in poses[:2]]})
    calibration = om.calibrate_rig(observations, known(rig, drop=("0000.png", "0001.png")))
    assert [list(camera.boards) for camera in calibration.cameras] == [["a"], ["a"]]
    assert_within_uncertainty(calibration, rig)
    every = tuple(f"{k:04d}.png" for k in range(8))
    with pytest.raises(ValueError, match=f"{rig.names[0]}: --drop leaves no image of this camera"):
        om.calibrate_rig(observations, known(rig, drop=every))
