"""Poses by cameras whose calibration is uncertain or wrong."""

from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest

import omnisight as om
from localization.known_points import localized, photographed, seen_from
from omnisight.geometry import rotation as so3
from omnisight.localization.focal_length_check import check_focal_length
from omnisight.localization.matched_points import MatchedPoints
from omnisight.models.kannala_brandt import KannalaBrandt

CAMERA = om.Camera(KannalaBrandt(fx=300.0, fy=300.0, cx=400.0, cy=390.0, k1=0.02, k2=0.0, k3=0.0, k4=0.0), (800, 800))


def covariance_of(relative):
    """Return the covariance of a calibration with a relative standard deviation of the focal length."""
    focal, center = 300 * relative, 100 * relative
    covariance = np.diag([focal, focal, center, center, relative, 0.0, 0.0, 0.0]) ** 2
    covariance[0, 1] = covariance[1, 0] = 0.99 * focal**2
    return covariance


def drawn(camera, rng):
    """Return a camera whose error is drawn from the covariance of its calibration."""
    return replace(
        camera, model=camera.model.with_params(rng.multivariate_normal(camera.model.params, camera.covariance))
    )


def scaled(camera, factor):
    """Return a camera with another focal length."""
    return replace(camera, model=replace(camera.model, fx=camera.model.fx * factor, fy=camera.model.fy * factor))


def images_of(world, true, assumed, rng, count):
    """Return localized images of a camera at random poses, and these poses."""
    visual_map, points = world
    poses = [om.Pose(so3.exp(rng.normal(0, 1.0, 3)), rng.normal(0, 0.5, 3)) for _ in range(count)]
    found = [localized(photographed(true, assumed, pose, points, rng), visual_map, assumed) for pose in poses]
    assert all(found)
    return found, poses


def normalized_square(image, pose):
    """Return the squared error of a pose over its covariance, 1 on average."""
    error = pose.step_to(image.cam_from_world)
    return error @ np.linalg.solve(image.covariance, error) / 6


@pytest.mark.parametrize("relative", [5e-4, 3e-3])
def test_the_uncertainty_of_the_calibration_is_part_of_that_of_the_pose(world, relative):
    camera, squares = replace(CAMERA, covariance=covariance_of(relative)), []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        (found,), (pose,) = images_of(world, drawn(camera, rng), camera, rng, 1)
        squares.append(normalized_square(found, pose))
    assert 0.85 < np.mean(squares) < 1.15  # 600 degrees of freedom: 0.06 (1 sigma); 3.3 and 200 without it


@pytest.mark.parametrize("factor", [0.98, 1.005, 1.02])
def test_a_wrong_focal_length_is_reported_and_its_effect_is_part_of_the_uncertainty(world, factor):
    images, poses = images_of(world, CAMERA, scaled(CAMERA, factor), np.random.default_rng(1), 5)
    before = np.mean([normalized_square(*each) for each in zip(images, poses, strict=True)])
    checked, change = check_focal_length(images)
    after = np.mean([normalized_square(*each) for each in zip(checked, poses, strict=True)])
    assert change.relative == pytest.approx(1 / factor - 1, abs=4 * change.sigma)
    assert change.sigma < 1e-3
    assert before > 10
    assert after < 1.5


class Unresectable(MatchedPoints):
    """Matches whose pose cannot be estimated again."""

    def resect(self):
        return SimpleNamespace(cam_from_world=None)


def test_the_effect_of_a_wrong_focal_length_is_part_of_the_uncertainty_without_a_second_pose(world):
    images, poses = images_of(world, CAMERA, scaled(CAMERA, 1.02), np.random.default_rng(1), 5)
    matched = images[0].matched_points
    values = {field.name: getattr(matched, field.name) for field in fields(matched)}
    images[0] = replace(images[0], matched_points=Unresectable(**values))
    checked, change = check_focal_length(images)
    assert change is not None
    assert normalized_square(images[0], poses[0]) > 10
    assert normalized_square(checked[0], poses[0]) < 3


@pytest.mark.parametrize("covariance", [None, covariance_of(1e-3)], ids=["exact", "uncertain"])
def test_a_correct_focal_length_is_not_reported(world, covariance):
    for seed in range(100):
        rng = np.random.default_rng(seed)
        camera = replace(CAMERA, covariance=covariance)
        true = CAMERA if covariance is None else drawn(camera, rng)
        images, _ = images_of(world, true, camera, rng, 2)
        checked, change = check_focal_length(images)
        assert change is None
        assert checked == images


def test_without_images_no_focal_length_is_reported():
    assert check_focal_length([]) == ([], None)


def test_360_images_have_no_focal_length(world):
    visual_map, points = world
    keypoints = seen_from(om.Pose(), points, np.random.default_rng(3), np.arange(200))
    image = localized(keypoints, visual_map)
    assert image
    assert check_focal_length([image]) == ([image], None)
