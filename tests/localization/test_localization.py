"""Localization in a map with known points and descriptors."""

import numpy as np
import pytest

import omnisight as om
from localization.known_points import DIMENSION, SPHERE, descriptors_of, localized, seen_from, unit
from omnisight.geometry import rotation as so3
from omnisight.localization.matched_points import MatchedPoints, match_points
from omnisight.pipeline.localization.visual_map import FILE
from omnisight.sfm.reconstruction import Points, Reconstruction


@pytest.mark.parametrize("wrong", [0.0, 0.4])
def test_a_pose_is_within_its_uncertainty_although_matches_are_wrong(world, wrong):
    visual_map, points = world
    normalized = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        pose = om.Pose(so3.exp(rng.normal(0, 1.0, 3)), rng.normal(0, 0.5, 3))
        found = localized(seen_from(pose, points, rng, rng.permutation(400)[:150], wrong), visual_map)
        assert found
        turn = so3.log(found.cam_from_world.rotation @ pose.rotation.T)
        error = np.append(turn, found.cam_from_world.translation - pose.translation)
        normalized.append(error @ np.linalg.solve(found.covariance, error) / 6)
    assert np.mean(normalized) == pytest.approx(1.0, abs=0.4)  # 120 degrees of freedom: 0.13 (1 sigma)


def test_the_uncertainty_of_the_points_is_part_of_that_of_the_pose(world):
    visual_map, points = world
    model = visual_map.reconstruction
    vague = Points(model.points.position, 100 * model.points.covariance, model.points.color)
    other = om.VisualMap(Reconstruction(**{**vars(model), "points": vague}), visual_map.descriptors)
    keypoints = seen_from(om.Pose(), points, np.random.default_rng(1), np.arange(100))
    near, far = localized(keypoints, visual_map), localized(keypoints, other)
    assert far.sigmas[0] > 2 * near.sigmas[0]
    assert far.sigmas[1] > 2 * near.sigmas[1]


@pytest.mark.parametrize("seed", [144, 200, 355, 356])
def test_a_pose_is_kept_that_the_noise_of_the_points_makes_ambiguous(seed):
    rng = np.random.default_rng(seed)
    points = unit(rng.normal(size=(32, 3))) * rng.uniform(2, 15, (32, 1))
    pose = om.Pose(translation=rng.normal(0, 0.7, 3))
    seen = unit(pose @ (points + rng.normal(0, 0.05, points.shape)))
    seen[:18] = unit(rng.normal(size=(18, 3)))
    noise = 1e-3**2 * (np.eye(3) - seen[:, :, None] * seen[:, None, :])
    covariance = np.tile(0.05**2 * np.eye(3), (32, 1, 1))
    found = MatchedPoints(SPHERE, SPHERE.project(seen)[0], seen, noise, points, covariance).resect()
    assert found, found.reason
    error = pose.step_to(found.cam_from_world)
    assert error @ np.linalg.solve(found.covariance, error) / 6 < 2.8  # the 99 % quantile


def test_errors_that_points_in_one_direction_share_are_part_of_the_uncertainty(world):
    """Points of an octant move together, as those that the same images of the map saw."""
    visual_map, points = world
    model = visual_map.reconstruction
    errors, variances = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        octant = (points > 0) @ [1, 2, 4]
        moved = points + rng.normal(0, 2e-3, (8, 3))[octant]
        bent = Points(moved, model.points.covariance, model.points.color)
        other = om.VisualMap(Reconstruction(**{**vars(model), "points": bent}), visual_map.descriptors)
        pose = om.Pose(so3.exp(rng.normal(0, 0.1, 3)), rng.normal(0, 0.3, 3))
        found = localized(seen_from(pose, points, rng, rng.permutation(400)[:300]), other)
        error = found.cam_from_world.inverse().translation - pose.inverse().translation
        errors.append(error @ error)
        variances.append(found.sigmas[1] ** 2)
    assert np.mean(errors) / np.mean(variances) == pytest.approx(1.0, abs=0.4)  # 15 without it


def test_images_of_other_places_are_not_localized(world):
    visual_map, points = world
    rng = np.random.default_rng(3)
    other = descriptors_of(np.arange(100), rng)[:, rng.permutation(DIMENSION)]
    elsewhere = seen_from(om.Pose(), points, rng, np.arange(100))
    unknown = om.Keypoints(elsewhere.pixels, elsewhere.bearings, elsewhere.covariance, elsewhere.scale, other)
    assert not localized(unknown, visual_map)
    shuffled = rng.permutation(100)
    alike = om.Keypoints(
        elsewhere.pixels, elsewhere.bearings, elsewhere.covariance, elsewhere.scale, elsewhere.descriptors[shuffled]
    )
    found = localized(alike, visual_map)
    assert not found
    assert "agree" in found.reason
    assert found.nearest
    nothing = localized(elsewhere[:0], visual_map)
    assert nothing.reason.startswith("no image of the map is similar")


def test_the_second_nearest_point_is_another_point():
    point = np.array([0, 0, 0, 1])
    of_points = unit(np.array([[1.0, 0, 0], [1, 0.01, 0], [1, 0, 0.01], [0, 1, 0]])).astype(np.float32)
    pairs = match_points(unit(np.array([[1.0, 0.005, 0.0], [0.5, 0.5, 0.7]])).astype(np.float32), of_points, point)
    assert pairs.tolist() == [[0, 0]]


def test_a_map_reads_back_and_damage_is_reported(world, tmp_path):
    visual_map, _ = world
    om.write_map(tmp_path, visual_map)
    again = om.read_map(tmp_path)
    assert np.abs(again.descriptors - visual_map.descriptors).max() < 0.01
    assert again.longest_track == pytest.approx(visual_map.longest_track)
    np.save(tmp_path / FILE, np.zeros((3, DIMENSION), np.uint8))
    with pytest.raises(ValueError, match=r"descriptors.npy: uint8 \(3, 128\), expected uint8 \(2400, D\)"):
        om.read_map(tmp_path)
    (tmp_path / FILE).write_bytes(b"x")
    with pytest.raises(ValueError, match=r"descriptors.npy: damaged"):
        om.read_map(tmp_path)
    (tmp_path / FILE).unlink()
    with pytest.raises(ValueError, match=r"has no descriptors.npy.*that omnisight map wrote"):
        om.read_map(tmp_path)


def test_the_widest_track_is_the_largest_angle_between_bearings(world):
    visual_map, _ = world
    images, degrees = visual_map.longest_track
    assert images == 6
    assert 60 < degrees <= 180
