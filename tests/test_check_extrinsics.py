"""The check of the extrinsics of a rig by images."""

import dataclasses

import numpy as np
import pytest

import omnisight as om
from omnisight.formats import load_rig
from omnisight.geometry.pose import Pose
from omnisight.pipeline.rig_calibration.check_extrinsics import MAX_ANGLE_RAD, check_extrinsics, is_epipolar


def bearings(points):
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def test_true_matches_are_epipolar_and_wrong_ones_are_not():
    chance = np.random.default_rng(0)
    pose = Pose(om.look(80, 20), np.array([0.3, -0.1, 0.2]))
    points = chance.normal(0, 2, (5000, 3))
    a, b = bearings(points), bearings(pose @ points)
    assert is_epipolar(a, b, pose).all()
    assert is_epipolar(a, b, pose.inverse()).mean() < 0.05
    assert is_epipolar(a, chance.permutation(b), pose).mean() < 0.02
    # Points behind the camera have the opposite bearing: the plane is right, and the half-plane wrong.
    assert not is_epipolar(a, -b, pose).mean() > 0.1
    assert np.degrees(MAX_ANGLE_RAD) == pytest.approx(0.5)


def test_the_omnimvs_rig_is_consistent_and_its_inverse_is_not(data):
    folder = data("omnimvs_rig")
    rig = load_rig(folder / "config.yaml").subset(["cam1", "cam2"])
    images = [folder / "cam1_00001.jpg", folder / "cam2_00001.jpg"]
    check = check_extrinsics(rig, images)
    assert check
    (pair,) = check.pairs
    assert 0.57 * pair.matches < pair.consistent
    assert pair.inverted < 0.1 * pair.matches
    wrong = check_extrinsics(rig.inverted(), images)
    assert wrong.verdict == "inverted"
    assert "--invert-extrinsics" in wrong.reason
    swapped = check_extrinsics(rig, images[::-1])
    assert not swapped


def test_images_without_texture_decide_nothing(data):
    rig = load_rig(data("hilti_rig") / "calib_3_cam0-1-camchain-imucam.yaml")
    gray = np.full((540, 720), 128, np.uint8)
    check = check_extrinsics(rig, [gray, gray])
    assert check.verdict == "unknown"
    assert "too few matches" in check.reason


def test_the_images_must_belong_to_the_rig(data):
    rig = load_rig(data("hilti_rig") / "calib_3_cam0-1-camchain-imucam.yaml")
    with pytest.raises(ValueError, match="1 images for 2 cameras: specify one of each, of cam0, cam1"):
        check_extrinsics(rig, [np.zeros((540, 720), np.uint8)])
    with pytest.raises(ValueError, match="100"):
        check_extrinsics(rig, [np.zeros((100, 100), np.uint8)] * 2)
    with pytest.raises(ValueError, match="the rig has one camera"):
        check_extrinsics(dataclasses.replace(rig.subset([0])), [np.zeros((540, 720), np.uint8)])
