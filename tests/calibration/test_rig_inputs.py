"""Rigs of special images: symmetric boards, no overlap, moved cameras, free-running cameras, wrong input."""

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks.rig_scenes import visible
from scipy.interpolate import CubicSpline

import omnisight as om
from calibration.rig_corners import FISHEYE, pose_errors, renamed, rig_scene, selected, with_moved_camera
from omnisight.geometry import rotation as so3
from omnisight.pipeline.rig_calibration.rig_calibration import rig_evidence
from omnisight.pipeline.rig_calibration.rig_cameras import check_not_mirrored
from omnisight.quality.rig_checks import rig_verdict
from omnisight.targets import Detection, ImageDetection, board_class

BOARD = om.Checkerboard(9, 6, 0.03)
MIDDLE = BOARD.points.mean(0)
MAX_SIGMAS = 3.0


def observe(rig, boards, noise=0.3, seed=0):
    """Return what each camera of a rig sees of its own board, whose poses rig_from_board are given by image."""
    rng, found = np.random.default_rng(seed), {}
    for name, camera, sensor in zip(rig.names, rig.cameras, rig.sensor_from_rig, strict=True):
        views = [(k, *visible(camera, sensor @ pose, BOARD)) for k, pose in enumerate(boards[name])]
        views = [(k, ids, at) for k, ids, at in views if len(ids) >= 12]
        found[name] = om.Observations.from_arrays(
            [BOARD.points[ids] for _, ids, _ in views],
            [at + rng.normal(0, noise, at.shape) for _, _, at in views],
            size=camera.size,
            names=[f"{k:04d}.png" for k, _, _ in views],
            extent=[BOARD.points[:, :2].min(0), BOARD.points[:, :2].max(0)],
            unit="m",
        )
    return found


def assert_within_uncertainty(calibration, true):
    for name, angle, length in zip(calibration.rig.names[1:], *pose_errors(calibration.rig, true), strict=True):
        assert angle < MAX_SIGMAS * calibration.sigmas(name)[0]
        assert length < MAX_SIGMAS * calibration.sigmas(name)[1]


def test_half_turns_of_symmetric_boards_are_resolved():
    true = rig_scene("stereo", 14)
    observations = true.observe(np.random.default_rng(2), outliers=0.0)
    right = observations["right"]
    low, high = right.extent
    turned = np.array([low[0] + high[0], low[1] + high[1], 0.0]) + right.points * [-1.0, -1.0, 1.0]
    half = np.random.default_rng(0).random(len(right)) < 0.5
    points = np.where(half[right.view_of_row][:, None], turned, right.points)
    calibration = om.calibrate_rig({**observations, "right": dataclasses.replace(right, points=points)}, FISHEYE)
    assert half.any()
    assert all(pair.agreeing == pair.shared for pair in calibration.pairs)
    assert_within_uncertainty(calibration, true.rig)


def test_cameras_without_a_common_view_are_connected_by_motion():
    fisheye = rig_scene("chain", 4).rig.cameras[0]
    back = om.look(170.0, 5.0)
    rig = om.Rig.from_sensors(
        {"front": (fisheye, om.Pose()), "back": (fisheye, om.Pose(back, -back @ np.array([0.05, 0.02, -0.1])))}
    )
    behind = om.look(180.0).T @ so3.exp([0.1, -0.1, 0.3])
    at_rest = {
        "front": om.Pose(so3.exp([0.1, 0.05, 0.02]), np.array([0.0, 0.0, 0.35]) - so3.exp([0.1, 0.05, 0.02]) @ MIDDLE),
        "back": om.Pose(behind, np.array([0.02, 0.03, -0.45]) - behind @ MIDDLE),
    }
    rng = np.random.default_rng(1)
    poses = [om.Pose(so3.exp(rng.uniform(-0.45, 0.45, 3)), rng.uniform(-0.08, 0.08, 3)) for _ in range(25)]
    boards = {name: [rig_from_world @ board for rig_from_world in poses] for name, board in at_rest.items()}
    calibration = om.calibrate_rig(observe(rig, boards), FISHEYE)
    assert_within_uncertainty(calibration, rig)
    assert calibration.sigmas("back")[1] < 0.003


def test_time_offsets_of_free_running_cameras_are_estimated(tmp_path):
    rig = rig_scene("stereo", 4).rig
    rng, knots = np.random.default_rng(1), np.arange(0, 14, 1.0)
    values = np.column_stack(
        [rng.uniform(-0.5, 0.5, (14, 3)), rng.uniform(-0.15, 0.15, (14, 2)), rng.uniform(0.3, 0.5, 14)]
    )
    motion = CubicSpline(knots, values)
    offset, times = 0.02, 0.5 + 0.1 * np.arange(90)

    def board(seconds):
        rotation = so3.exp(motion(seconds)[:3])
        return om.Pose(rotation, motion(seconds)[3:] - rotation @ MIDDLE)

    observations = observe(rig, {"left": [board(t) for t in times], "right": [board(t + offset) for t in times]})
    rows = [f"{name},{k:04d}.png,{t}" for name in rig.names for k, t in enumerate(times)]
    (tmp_path / "times.csv").write_text("camera,frame,seconds\n" + "\n".join(rows))
    calibration = om.calibrate_rig(observations, dataclasses.replace(FISHEYE, times=tmp_path / "times.csv"))
    assert calibration.rule == "time"
    assert calibration.rig.time_offsets[1] == pytest.approx(offset, abs=5e-4)
    (angle,), _ = pose_errors(calibration.rig, rig)
    (without,), _ = pose_errors(om.calibrate_rig(observations, FISHEYE).rig, rig)
    assert angle < 0.5 * without


def test_a_board_that_moves_between_exposures_is_reported():
    rig, rng = rig_scene("stereo", 4).rig, np.random.default_rng(4)
    poses = rig_scene("stereo", 16).rig_from_board
    shaken = [
        om.Pose(so3.exp(rng.normal(0, 0.004, 3)) @ p.rotation, p.translation + rng.normal(0, 0.001, 3)) for p in poses
    ]
    calibration = om.calibrate_rig(observe(rig, {"left": poses, "right": shaken}), FISHEYE)
    motion = calibration.estimate.problem.motion
    assert motion is not None
    assert calibration.estimate.move is None
    (reason,) = [reason for reason in calibration.reasons if "moved by about" in reason]
    assert "or their models are not exact" in reason
    assert "specify --times" in reason
    evidence = dataclasses.replace(rig_evidence(calibration), has_times=True)
    assert not any("--times" in reason for reason in rig_verdict(evidence).reasons)
    assert_within_uncertainty(calibration, rig)
    assert calibration.rms == pytest.approx(0.42, abs=0.06)  # the motion is in no residual


@pytest.mark.parametrize("step", [(0.01, 0.005, 0, 0.003, 0, 0), (0.2, 0.05, 0, 0.03, 0.05, 0)], ids=["little", "far"])
def test_a_camera_that_moved_is_named_with_its_image(step):
    true = rig_scene("chain")
    observations = true.observe(np.random.default_rng(3))
    moved = with_moved_camera(true, observations, "right", 24, np.array(step))
    calibration = om.calibrate_rig(moved, FISHEYE)
    assert str(calibration.verdict) == "do not use"
    move = calibration.estimate.move
    assert (move.kind, calibration.estimate.name_of(move)) == ("camera", "right")
    assert move.before < "0024.png" <= move.after
    assert move.angle == pytest.approx(np.linalg.norm(step[:3]), rel=0.3)
    assert f"right moved by {1e3 * move.distance:.3g} mm" in calibration.reasons[0]
    assert move.after in calibration.reasons[0]


@pytest.mark.parametrize("step", [(0.003, 0.004, 0, 0.001, 0, 0.002), (0.003, 0.004, 0, 0, 0, 0)], ids=["both", "turn"])
def test_a_slight_move_is_no_motion_of_the_board(step):
    true = rig_scene("stereo")
    moved = with_moved_camera(true, true.observe(np.random.default_rng(3)), "right", 10, np.array(step))
    calibration = om.calibrate_rig(moved, FISHEYE)
    move = calibration.estimate.move
    assert str(calibration.verdict) == "do not use"
    assert (move.before, move.after) == ("0009.png", "0010.png")
    assert move.angle == pytest.approx(np.linalg.norm(step[:3]), rel=0.2)
    assert move.distance == pytest.approx(np.linalg.norm(step[3:]), abs=4e-4)
    assert not any("The board moved by about" in reason for reason in calibration.reasons)
    # One side of the move determines the extrinsics.
    after = dataclasses.replace(true.rig, sensor_from_rig=(om.Pose(), true.rig.sensor_from_rig[1].moved(step)))
    errors = [np.ravel(pose_errors(calibration.rig, rig)) for rig in (true.rig, after)]
    assert (np.min(errors, axis=0) < MAX_SIGMAS * np.array(calibration.sigmas("right"))).all()


def test_images_that_are_not_simultaneous_are_refused():
    observations = rig_scene("chain").observe(np.random.default_rng(3))
    shifted = {**observations, "right": renamed(observations["right"], 1)}
    with pytest.raises(ValueError, match=r"not connected .*middle-right 1\d \(. agree.*not simultaneous.*--times"):
        om.calibrate_rig(shifted, FISHEYE)


def test_one_image_that_is_not_simultaneous_is_named():
    true = rig_scene("stereo", 16)
    observations = true.observe(np.random.default_rng(3), outliers=0.0)
    right = observations["right"]
    order = list(range(len(right)))
    order[4], order[5] = order[5], order[4]
    names = list(right.names)
    names[4], names[5] = names[5], names[4]
    calibration = om.calibrate_rig({**observations, "right": dataclasses.replace(right, names=tuple(names))}, FISHEYE)
    (reason,) = [r for r in (*calibration.reasons, *calibration.notes) if "contradict" in r]
    assert names[4] in reason
    assert names[5] in reason
    assert_within_uncertainty(calibration, true.rig)


def test_cameras_without_common_images_are_listed_with_advice():
    observations = rig_scene("chain").observe(np.random.default_rng(3))
    middle, right = observations["middle"], observations["right"]
    alone = [v for v, name in enumerate(right.names) if name not in middle.names]
    few = {**observations, "right": selected(right, [(right, v) for v in alone])}
    with pytest.raises(ValueError, match=r"right \| left, middle\).*middle-right 0; take about 10 images"):
        om.calibrate_rig(few, FISHEYE)


def flipped(observations, *, has_markers):
    """Return the observations in mirror images; without markers, boards are numbered from the other side."""
    pixels, points = observations.pixels.copy(), observations.points.copy()
    pixels[:, 0] = observations.size[0] - 1 - pixels[:, 0]
    if not has_markers:
        points[:, 0] = observations.extent[:, 0].sum() - points[:, 0]
    return dataclasses.replace(observations, pixels=pixels, points=points)


@pytest.mark.parametrize("has_markers", [False, True])
def test_a_camera_with_mirror_images_is_named(has_markers):
    observations = rig_scene("chain").observe(np.random.default_rng(3), outliers=0.0)
    observations["middle"] = flipped(observations["middle"], has_markers=has_markers)
    with pytest.raises(ValueError, match=r"^the images of middle are mirror images: .*Turn off the mirror mode"):
        om.calibrate_rig(observations, FISHEYE)
    two = {name: observations[name] for name in ("left", "middle")}
    named = "middle" if has_markers else "left or middle"
    with pytest.raises(ValueError, match=rf"^the images of {named} are mirror images"):
        om.calibrate_rig(two, FISHEYE)


@pytest.mark.parametrize("mirrored", [("a",), ("a", "b"), ()])
def test_cameras_with_mirrored_markers_are_named(mirrored):
    board = board_class("aprilgrid")(3, 3, 0.03, 0.3)
    at = {True: (-900, 900), False: (900, 900)}
    cameras = []
    for name in "ab":
        pixels, covariance = (
            board.points[:, :2] * at[name in mirrored] + 300,
            np.tile(0.01 * np.eye(2), (board.size, 1, 1)),
        )
        views = [Detection(np.arange(board.size), pixels, covariance)] * 3
        images = [ImageDetection(Path(f"{k}.png"), (640, 480), (view,)) for k, view in enumerate(views)]
        cameras.append(
            SimpleNamespace(name=name, boards={"board": SimpleNamespace(detections=om.Detections(board, images))})
        )
    if not mirrored:
        check_not_mirrored(cameras)
        return
    with pytest.raises(ValueError, match=rf"^the images of {' and '.join(mirrored)} are mirror images: the markers"):
        check_not_mirrored(cameras)


def test_too_few_images_of_a_camera_are_refused_without_an_option_of_another_command():
    observations = rig_scene("stereo", 6).observe(np.random.default_rng(3))
    with pytest.raises(ValueError, match=r"^right: 1 image with a board: at least 3 are needed") as error:
        om.calibrate_rig({**observations, "right": observations["right"].subset([0])}, FISHEYE)
    assert "--force" not in str(error.value)


def test_wrong_input_is_refused_with_the_value(tmp_path):
    observations = rig_scene("stereo", 6).observe(np.random.default_rng(3))
    with pytest.raises(ValueError, match=r"1 camera, and a rig has at least two"):
        om.calibrate_rig({"left": observations["left"]}, FISHEYE)
    with pytest.raises(ValueError, match=r"--reference top: there is no such camera; there are left, right"):
        om.calibrate_rig(observations, om.CalibrateRigOptions(reference="top"))
    with pytest.raises(ValueError, match=r"--camera front=.*NAME=FILE|--camera front: there are no images"):
        om.calibrate_rig(observations, om.CalibrateRigOptions(camera=("front=a.json",)))
    with pytest.raises(ValueError, match=r"--camera a.json: must be NAME=FILE"):
        om.calibrate_rig(observations, om.CalibrateRigOptions(camera=("a.json",)))
    squares = dataclasses.replace(observations["right"], unit="squares")
    with pytest.raises(ValueError, match=r"known for some of the cameras only: specify --square"):
        om.calibrate_rig({**observations, "right": squares}, FISHEYE)
    small = tmp_path / "small.json"
    om.save(rig_scene("stereo", 6).rig.cameras[0].scaled(0.5), small)
    with pytest.raises(ValueError, match=r"left: .*480x360 px, but these are 960x720 px: are the folders"):
        om.calibrate_rig(observations, om.CalibrateRigOptions(camera=(f"left={small}",)))
    invalid = {
        "camera,frame\n": "has no column seconds",
        "camera,frame,seconds\nleft,0,x\n": "line 2",
        200_000 * "0": "times.csv: is no CSV file",
    }
    for text, message in invalid.items():
        (tmp_path / "times.csv").write_text(text)
        with pytest.raises(ValueError, match=message):
            om.calibrate_rig(observations, dataclasses.replace(FISHEYE, times=tmp_path / "times.csv"))


def test_the_same_images_for_two_cameras_are_refused():
    left = rig_scene("stereo", 6).observe(np.random.default_rng(3))["left"]
    with pytest.raises(ValueError, match="the images of left and right are identical"):
        om.calibrate_rig({"left": left, "right": left}, FISHEYE)


def test_notes_on_the_images_of_a_camera_are_reported():
    observations = rig_scene("stereo", 6).observe(np.random.default_rng(3), outliers=0.0)
    calibration = om.calibrate_rig(observations, FISHEYE)
    assert calibration.notes == ()
    left, right = calibration.cameras
    notes = om.Detections(None, notes=("3 images of another size are left out",))
    views = {board: dataclasses.replace(views, detections=notes) for board, views in right.boards.items()}
    calibration = dataclasses.replace(calibration, cameras=(left, dataclasses.replace(right, boards=views)))
    assert calibration.notes == ("right: 3 images of another size are left out",)


def test_exchanged_folders_of_known_cameras_are_recognized(tmp_path):
    true = rig_scene("stereo", 6)
    wide = dataclasses.replace(true.rig.cameras[1].model, fx=380.0, fy=380.0)
    rig = dataclasses.replace(true.rig, cameras=(true.rig.cameras[0], om.Camera(wide, (960, 720), theta_max=1.3)))
    observations = dataclasses.replace(true, rig=rig).observe(np.random.default_rng(3), outliers=0.0)
    files = {name: tmp_path / f"{name}.json" for name in rig.names}
    for name, camera in zip(rig.names, rig.cameras, strict=True):
        om.save(camera, files[name])
    options = om.CalibrateRigOptions(camera=tuple(f"{name}={file}" for name, file in files.items()))
    assert om.calibrate_rig(observations, options).rms < 0.5
    exchanged = {"left": observations["right"], "right": observations["left"]}
    with pytest.raises(ValueError, match=r"the images of left fit the camera file of right better .*exchanged"):
        om.calibrate_rig(exchanged, options)
