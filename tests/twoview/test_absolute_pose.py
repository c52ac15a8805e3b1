"""Resection from noisy bearings of known points with outliers: accuracy, true covariance, and precise failures."""

import numpy as np
import pytest
from scenes import directions, noisy, normalized_squares, step_between

import omnisight as om
from omnisight.geometry.rotation import exp


def sample(seed, fov_deg=190.0, outliers=0.3, sigma_deg=0.1, count=120):
    """Return points in the world, noisy bearings, some of other points, and the pose."""
    rng = np.random.default_rng(seed)
    pose = om.Pose(exp(rng.normal(size=3)), 2 * rng.normal(size=3))
    bearings = directions(rng, count, fov_deg)
    points = pose.inverse() @ (bearings * rng.uniform(2, 10, (count, 1)))
    wrong = rng.permutation(count)[: round(outliers * count)]
    bearings[wrong] = bearings[np.roll(wrong, 1)]
    return points, noisy(rng, bearings, sigma_deg), pose


@pytest.mark.parametrize("fov_deg", [60, 190, 360])
@pytest.mark.parametrize("outliers", [0.0, 0.7])
def test_the_pose_is_found_in_any_field_of_view(fov_deg, outliers):
    for seed in range(5):
        points, bearings, pose = sample(seed, fov_deg, outliers)
        found = om.resect(points, bearings)
        assert found, found.reason
        step = step_between(found.cam_from_world, pose)
        assert np.degrees(np.linalg.norm(step[:3])) < 0.25
        assert np.linalg.norm(step[3:]) < 0.03


@pytest.mark.slow
@pytest.mark.parametrize("outliers", [0.0, 0.5])
@pytest.mark.parametrize("is_known", [True, False])
def test_covariance_is_that_of_the_errors(outliers, is_known):
    steps, covariances, sigmas = [], [], []
    for seed in range(250):
        points, bearings, pose = sample(seed, outliers=outliers)
        found = om.resect(points, bearings, sigma_deg=0.1 if is_known else None)
        steps.append(step_between(found.cam_from_world, pose))
        covariances.append(found.covariance)
        sigmas.append(found.sigma_deg)
    # The mean of 250 chi-squared variables of six degrees of freedom has the standard deviation 0.037.
    assert 0.85 < normalized_squares(steps, covariances, 6).mean() < 1.15
    assert np.mean(sigmas) == pytest.approx(0.1, rel=0.02)


def test_unrelated_points_and_few_points_have_no_pose():
    rng = np.random.default_rng(0)
    found = om.resect(rng.normal(size=(60, 3)), directions(rng, 60, 120))
    assert not found
    assert found.cam_from_world is None
    assert "by chance" in found.reason
    assert om.resect(np.eye(3), np.eye(3)).reason == "3 correspondences, at least 6 are needed"


def test_arrays_that_hold_no_points_are_refused():
    with pytest.raises(ValueError, match=r"points must have the shape of the bearings, \(6, 3\), got \(5, 3\)"):
        om.resect(np.ones((5, 3)), np.ones((6, 3)))
    with pytest.raises(ValueError, match=r"points\[2\] is not finite"):
        om.resect([[0, 0, 1], [0, 1, 1], [np.inf, 0, 0]], np.ones((3, 3)))


def test_a_distant_plane_with_two_poses_has_no_wrong_one():
    rng = np.random.default_rng(0)
    camera = om.perspective((640, 480), 60)
    grid = np.stack(np.meshgrid(np.arange(-4.0, 5), np.arange(-2.5, 3), [0.0]), -1).reshape(-1, 3)
    returned, refused = 0, 0
    for _ in range(40):
        turn = exp([rng.uniform(0.2, 0.7), rng.uniform(-0.5, 0.5), rng.uniform(-3, 3)])
        pose = om.Pose(turn, np.array([0, 0, 133.0]))
        pixels, _ = camera.project(pose @ grid)
        found = om.resect(grid, pixels + rng.normal(size=pixels.shape) * 0.3, camera=camera)
        if found:
            returned += 1
            step = step_between(found.cam_from_world, pose)
            assert normalized_squares([step], [found.covariance], 6)[0] < 10
        else:
            refused += 1
            assert found.reason.endswith("probable")
    # Without a comparison of both poses, 11 of 100 were wrong by more than 5 standard deviations.
    assert returned >= 15
    assert refused >= 5


@pytest.mark.parametrize(("seed", "largest"), [(47, 6), (58, 6), (62, 6), (101, 6.5), (159, 6)])
def test_optima_of_one_solution_are_part_of_its_covariance(seed, largest):
    """Points with more noise than stated leave several optima with other outliers, a few standard deviations apart."""
    rng = np.random.default_rng(seed)
    pose = om.Pose(exp(rng.normal(size=3)), 2 * rng.normal(size=3))
    bearings = directions(rng, 100, 65)
    points = pose.inverse() @ (bearings * rng.uniform(2, 10, (100, 1)))
    noise = np.where(rng.random(100) < 0.6, rng.uniform(3, 8, 100), 1.0)
    found = om.resect(points, noisy(rng, bearings, 0.1 * noise[:, None]), sigma_deg=0.1)
    assert found, found.reason  # another optimum was 12 to 40 % probable, and the pose refused
    step = step_between(found.cam_from_world, pose)
    assert normalized_squares([step], [found.covariance], 6)[0] < largest
