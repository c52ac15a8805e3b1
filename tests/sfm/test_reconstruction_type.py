"""What a reconstruction reports of itself."""

import dataclasses
from itertools import combinations

import numpy as np
import pytest

from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import hat
from omnisight.sfm.missing_matches import ComparedImages, PredictedMatches
from omnisight.sfm.verification import MIN_VERIFIED, verified_frames
from reconstructing import single

NONE_COMPARED = ComparedImages(np.zeros((0, 2), np.intp), [])


def verified(made, keep, compared=NONE_COMPARED):
    observations = made.observations.select(keep)
    return verified_frames(observations.image, observations.point, made.frame, compared, 1.0).tolist()


def test_images_with_few_points_that_other_images_share_are_not_verified():
    made = single(frames=6)
    image, point = made.observations.image, made.observations.point
    assert verified(made, image >= 0) == [True] * 6
    seen = np.unique(point[image == 5])
    assert verified(made, (image != 5) | np.isin(point, seen[: MIN_VERIFIED - 1])) == [True] * 5 + [False]
    assert verified(made, (image != 5) | np.isin(point, seen[:MIN_VERIFIED])) == [True] * 6
    assert verified(made, image >= 4) == [False] * 6


@pytest.mark.parametrize(("share", "is_contradicted"), [(0.4, True), (0.6, False)])
def test_parts_between_which_more_matches_are_missing_than_agree_are_apart(share, is_contradicted):
    made = single(frames=6)
    pairs = np.array(list(combinations(range(6), 2)))
    is_across = (pairs < 4).sum(axis=1) == 1
    predictions = [PredictedMatches(50 / share if apart else 50.0, 50.0, 50, 100) for apart in is_across]
    every = made.observations.image >= 0
    assert verified(made, every, ComparedImages(pairs, predictions)) == [True] * 4 + [not is_contradicted] * 2
    within = ComparedImages(pairs[~is_across], [PredictedMatches(50.0, 50.0, 50, 100)] * int((~is_across).sum()))
    assert verified(made, every, within) == [True] * 6  # images that were not compared lack no matches


def test_the_uncertainty_of_rotations_is_that_of_the_verified_images():
    made = single(frames=6)
    sigma_deg = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 5.0])
    made = dataclasses.replace(made, pose_covariance=np.radians(sigma_deg)[:, None, None] ** 2 * np.eye(6))
    assert made.rotation_sigma_deg == pytest.approx(0.3)
    assert dataclasses.replace(made, unverified=made.names[5:]).rotation_sigma_deg == pytest.approx(0.25)
    assert np.isnan(dataclasses.replace(made, unverified=made.names).rotation_sigma_deg)


def test_residuals_along_the_rows_of_a_panorama_are_in_pixels_of_the_equator():
    made = single(frames=4)
    pixels = made.observations.pixels
    latitude = (pixels[:, 1] + 0.5) / 320 * np.pi - np.pi / 2
    residuals = np.column_stack([0.5 / np.cos(latitude), np.zeros(len(pixels))])
    observations = dataclasses.replace(made.observations, residuals=residuals)
    assert dataclasses.replace(made, observations=observations).rms_px == pytest.approx(0.5, rel=1e-6)


def test_of_two_parts_that_no_three_images_connect_the_larger_is_verified():
    made = single(frames=8)
    image, point = made.observations.image, made.observations.point
    apart = (image < 5) & (point % 2 == 0) | (image >= 5) & (point % 2 == 1)
    assert verified(made, apart) == [True] * 5 + [False] * 3
    few = np.unique(point[image == 4])
    bridge = (image == 4) & np.isin(point, few[few % 2 == 1][: MIN_VERIFIED - 1])
    assert verified(made, apart | bridge) == [True] * 5 + [False] * 3
    bridge = np.isin(image, (3, 4)) & (point % 2 == 1)
    assert verified(made, apart | bridge) == [True] * 8


def test_parts_that_only_one_image_connects_are_apart_because_their_relative_scale_is_open():
    made = single(frames=8)
    image, point = made.observations.image, made.observations.point
    apart = (image < 5) & (point % 2 == 0) | (image >= 4) & (point % 2 == 1)
    assert verified(made, apart) == [True] * 5 + [False] * 3
    images, points = np.arange(8), np.arange(MIN_VERIFIED)
    # The first points are in images 0 to 3, and so on: a chain in which any two neighbours have two images in common.
    seen = [(i, MIN_VERIFIED * k + p) for k in range(3) for i in images[2 * k : 2 * k + 4] for p in points]
    chain = np.array(seen).T
    assert verified_frames(*chain, images, NONE_COMPARED, 1.0).all()
    assert verified_frames(*chain, images // 2, NONE_COMPARED, 1.0).all()  # two images of a frame know their distance
    one = chain[:, (chain[0] != 3) | (chain[1] >= MIN_VERIFIED)]  # only image 2 connects the first part
    assert verified_frames(*one, images, NONE_COMPARED, 1.0).tolist() == [False] * 2 + [True] * 6


def test_the_uncertainty_of_the_scale_does_not_depend_on_the_origin():
    made = single(frames=6)
    sigma = np.repeat([np.radians(0.05), 0.01], 3)
    covariance = np.array([np.zeros((6, 6)), *[np.diag(sigma**2)] * 5])
    here = dataclasses.replace(made, pose_covariance=covariance)
    offset = np.array([1000.0, -2000.0, 50.0])
    far_poses, far_covariance = list[Pose](), list[np.ndarray]()
    for pose, of_pose in zip(made.rig_from_world, covariance, strict=True):
        shift = pose.rotation @ offset
        far_poses.append(Pose(pose.rotation, pose.translation - shift))
        # t' = t - R offset, and a rotation by w changes R offset by w x R offset.
        by_step = np.block([[np.eye(3), np.zeros((3, 3))], [hat(shift), np.eye(3)]])
        far_covariance.append(by_step @ of_pose @ by_step.T)
    far = dataclasses.replace(made, rig_from_world=tuple(far_poses), pose_covariance=np.array(far_covariance))
    assert far.scale_sigma == pytest.approx(here.scale_sigma, rel=1e-6)
    assert here.scale_sigma > 0
