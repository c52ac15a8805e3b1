"""The motion model of pairs of bearings is recognized, and a rotation has no translation."""

from collections import Counter

import numpy as np
import pytest
from benchmarks.twoview_scenes import Cell
from scenes import Scene, normalized_squares, step_between, unit

import omnisight as om
from omnisight.geometry.rotation import exp


class Rotation(Scene):
    def motion(self, rng):
        return om.Pose(super().motion(rng).rotation)


class Planar(Scene):
    def motion(self, rng):
        return om.Pose(exp([0, rng.uniform(0.1, 0.4), 0]), unit(rng.normal(size=3) * [1, 0, 1]))


class Plane(Scene):
    """Points of a plane three baselines away."""

    def distances(self, rng, bearings):
        along = bearings @ unit(np.array([0.2, 1.0, 0.3]))
        return np.where(along > 0.1, 3 / along, np.nan)[:, None]


class Wall(Scene):
    """A wall ahead, and motion by 40° from its normal."""

    def motion(self, rng):
        azimuth = rng.uniform(0, 2 * np.pi)
        t = [np.sin(0.7) * np.cos(azimuth), np.sin(0.7) * np.sin(azimuth), -np.cos(0.7)]
        return om.Pose(exp(rng.normal(size=3) * 0.05), np.array(t))

    def distances(self, rng, bearings):
        return 4 / bearings[:, 2:]


class RoughWall(Wall):
    """A wall and, for every eighth bearing, points in front of it."""

    def distances(self, rng, bearings):
        return super().distances(rng, bearings) * np.where(rng.random((len(bearings), 1)) < 0.12, 0.6, 1)


class Far(Scene):
    """Points at 120 to 600 baselines, whose parallax is a few times the noise."""

    def distances(self, rng, bearings):
        return 60 * super().distances(rng, bearings)


class DistantPlane(Scene):
    """Points of a plane 12 baselines away."""

    def distances(self, rng, bearings):
        along = bearings @ unit(np.array([0.2, 0.3, 1.0]))
        return np.where(along > 0.1, 12 / along, np.nan)[:, None]


KINDS = {"general": Scene, "rotation only": Rotation, "planar motion": Planar, "dominant plane": Plane}


@pytest.mark.parametrize("fov_deg", [60, 190, 360])
@pytest.mark.parametrize("outliers", [0.0, 0.5])
@pytest.mark.parametrize("name", KINDS)
def test_the_motion_model_is_recognized(name, fov_deg, outliers):
    names = Counter()
    for seed in range(6):
        a, b, *_ = KINDS[name](fov_deg, outliers).pairs(seed)
        names[om.relative_pose(a, b).motion.name] += 1
    assert names[name] >= 5, names


def test_a_rotation_has_no_translation_and_a_true_covariance():
    steps, covariances = [], []
    for seed in range(100):
        a, b, pose, _ = Rotation(190, 0.5, count=100).pairs(seed)
        found = om.relative_pose(a, b, sigma_deg=0.05)
        assert found
        assert found.motion.name == "rotation only"
        assert not found.b_from_a.translation.any()
        steps.append(step_between(found.b_from_a, pose)[:3])
        covariances.append(found.covariance[:3, :3])
    # The mean of 100 chi-squared variables of three degrees of freedom has the standard deviation 0.08.
    assert 0.76 < normalized_squares(steps, covariances, 3).mean() < 1.24


def test_a_rotation_with_few_inliers_is_recognized_or_ambiguous():
    """Of one of the pairs, the most probable general motion has two inliers."""
    names = Counter()
    for seed in range(365, 385):
        a, b, *_ = Rotation(190, 0.7, count=200).pairs(seed)
        names[om.relative_pose(a, b, sigma_deg=0.05).motion.name] += 1
    assert names["rotation only"] >= 19, names
    assert names["ambiguous"] == 20 - names["rotation only"], names


def test_a_translation_along_a_plane_in_a_narrow_field_of_view_is_not_a_rotation():
    """Two thirds of the inliers agree with a rotation that is wrong by 8°."""
    a, b, truth = Cell("plane", 60, 0.7, 0.2).pair(1065)
    found = om.relative_pose(a, b, sigma_deg=0.2)
    assert found.motion.name == "insufficient parallax"
    assert np.degrees(np.linalg.norm(step_between(found.b_from_a, truth)[:3])) < 1.0


@pytest.mark.parametrize("fov_deg", [60, 190])
@pytest.mark.parametrize("outliers", [0.0, 0.6])
def test_the_pose_in_front_of_a_plane_has_a_true_covariance(fov_deg, outliers):
    steps, covariances = [], []
    for seed in range(100):
        a, b, pose, _ = Plane(fov_deg, outliers).pairs(seed)
        found = om.relative_pose(a, b, sigma_deg=0.05)
        steps.append(step_between(found.b_from_a, pose))
        covariances.append(found.covariance)
    # The mean of 100 chi-squared variables of five degrees of freedom has the standard deviation 0.063.
    assert 0.81 < normalized_squares(steps, covariances, 5).mean() < 1.19


@pytest.mark.parametrize("outliers", [0.0, 0.4])
def test_a_wall_has_two_motions_which_other_points_decide(outliers):
    """A wall straight ahead is in front of both cameras for both motions of its homography."""
    steps, covariances, is_first = [], [], []
    for seed in range(60):
        a, b, pose, _ = Wall(60, outliers).pairs(seed)
        found = om.relative_pose(a, b, sigma_deg=0.05)
        assert found.motion.name == "dominant plane"
        assert found.alternative is not None
        steps.append(step_between(found.b_from_a, pose))
        covariances.append(found.covariance)
        errors = [np.linalg.norm(step_between(p, pose)[:3]) for p in (found.b_from_a, found.alternative)]
        assert min(errors) < np.radians(1)
        is_first.append(errors[0] < errors[1])
    assert 15 < sum(is_first) < 45
    assert 0.6 < normalized_squares(steps, covariances, 5).mean() < 1.4
    for seed in range(10):
        a, b, pose, _ = RoughWall(60, outliers).pairs(seed)
        found = om.relative_pose(a, b, sigma_deg=0.05)
        assert found.alternative is None
        assert np.linalg.norm(step_between(found.b_from_a, pose)[:3]) < np.radians(1)


@pytest.mark.parametrize("error_deg", [0.1, 0.2])
def test_a_rotation_through_a_slightly_wrong_camera_is_not_a_motion_before_a_plane(error_deg):
    """A radial error of the calibration has a field of residuals that a homography describes better than a rotation."""
    rng = np.random.default_rng(0)
    rotation = exp(np.radians([2.0, 20.0, -3.0]))

    def distorted(x):
        theta, phi = np.arctan2(np.hypot(x[:, 0], x[:, 1]), x[:, 2]), np.arctan2(x[:, 1], x[:, 0])
        theta = theta + np.radians(error_deg) * (theta / (np.pi / 2)) ** 3
        return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)

    a = unit(rng.normal(size=(3000, 3)) * [1, 1, 0.5] + [0, 0, 0.5])
    a = a[a[:, 2] > -0.3]
    b = a @ rotation.T
    use = b[:, 2] > -0.3
    a, b = (distorted(x[use]) + rng.normal(0, np.radians(0.05), (int(use.sum()), 3)) for x in (a, b))
    found = om.relative_pose(a, b)
    assert found.motion.name in ("rotation only", "insufficient parallax")


def test_identical_bearings_are_a_rotation_by_zero():
    a, *_ = Scene().pairs(0)
    found = om.relative_pose(a, a)
    assert found.motion.name == "rotation only"
    assert np.abs(found.b_from_a.rotation - np.eye(3)).max() < 1e-9


def test_distant_points_of_a_narrow_field_leave_the_direction_unknown():
    for seed in range(10):
        a, b, *_ = Far(60, 0.0).pairs(seed)
        assert om.relative_pose(a, b).motion.name in ("rotation only", "insufficient parallax")


def test_a_plane_with_little_parallax_has_a_true_covariance():
    """Its homography determines the pose, while the epipolar geometry alone has distant local optima."""
    steps, covariances, names = [], [], Counter()
    for seed in range(60):
        a, b, pose, _ = DistantPlane(60, 0.3, 0.2, count=500).pairs(seed)
        found = om.relative_pose(a, b, sigma_deg=0.2)
        names[found.motion.name] += 1
        steps.append(step_between(found.b_from_a, pose))
        covariances.append(found.covariance)
    assert names["insufficient parallax"] > 20
    assert names["insufficient parallax"] + names["dominant plane"] == 60
    # The mean of 60 chi-squared variables of five degrees of freedom has the standard deviation 0.08.
    assert 0.75 < normalized_squares(steps, covariances, 5).mean() < 1.25


def test_unrelated_pairs_do_not_overlap():
    rng = np.random.default_rng(0)
    a, b = (unit(rng.normal(size=(100, 3))) for _ in range(2))
    found = om.relative_pose(a, b)
    assert found.motion.name == "no overlap"
    assert "by chance" in found.motion.figure
