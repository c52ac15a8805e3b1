"""Noise of keypoints by the residuals of maps, and the covariances that follow from it."""

from dataclasses import replace

import numpy as np
import pytest

from omnisight.geometry.pose import Pose
from omnisight.optim.loss import StudentT
from omnisight.sfm.bundle_adjustment import Bundle, adjust_bundle
from omnisight.sfm.noise import noise_of_map
from omnisight.sfm.structure import RayObservations, Structure
from omnisight.twoview.triangulation import whitening
from sfm.worlds import circle_of_poses, points_around, unit

SIGMA = np.radians(0.05)


def truth_and_rays(count, *, views, stated=1.0, seed=0):
    """Return the true structure, and rays of points each seen by some of six cameras, with normal errors."""
    rng, poses = np.random.default_rng(seed), circle_of_poses(6)
    matrices, points = np.array([pose.matrix for pose in poses]), points_around(count)
    frame = np.argsort(rng.random((count, len(poses))), axis=1)[:, :views].ravel()
    point = np.repeat(np.arange(count), views)
    in_cameras = np.einsum("mij,mj->mi", matrices[frame, :, :3], points[point]) + matrices[frame, :, 3]
    directions = unit(in_cameras)
    bearings = unit(directions + rng.normal(0, SIGMA, directions.shape))
    covariance = (SIGMA * stated) ** 2 * (np.eye(3) - bearings[:, :, None] * bearings[:, None, :])
    rays = RayObservations(frame, 0 * frame, point, np.zeros_like(bearings), bearings, whitening(covariance))
    return Structure(matrices, np.eye(3, 4)[None], points), rays


def adjusted(truth, rays):
    """Return the bundle with the noise of its residuals, and its optimum."""
    bundle = Bundle(rays, StudentT(), truth)
    bundle = replace(bundle, loss=noise_of_map(bundle, adjust_bundle(bundle).state))
    state = adjust_bundle(bundle).state
    return replace(bundle, loss=noise_of_map(bundle, state)), state


@pytest.mark.parametrize("views", [2, 3, 6])
@pytest.mark.parametrize("stated", [0.5, 2.0])
def test_noise_is_that_of_the_keypoints_however_few_images_show_a_point(views, stated):
    noise = noise_of_map(*adjusted(*truth_and_rays(3000, views=views, stated=stated)))
    assert noise.sigma * stated == pytest.approx(1.0, rel=0.03)
    assert noise.degrees >= 50  # normal errors have no tails


@pytest.mark.parametrize("views", [2, 4])
def test_errors_of_poses_have_the_stated_covariance(views):
    ratios = []
    for seed in range(30):
        truth, rays = truth_and_rays(300, views=views, seed=seed)
        bundle, state = adjusted(truth, rays)
        variances = bundle.covariances(state)[0].diagonal
        columns, free = bundle.parameters[0], bundle.parameters[0] >= 0
        pairs = zip(truth.rig_from_world, state.rig_from_world, strict=True)
        steps = np.array([Pose.of_matrix(true).step_to(Pose.of_matrix(found)) for true, found in pairs])
        ratios.append(steps[free] ** 2 / variances[columns[free]])
    assert np.sqrt(np.mean(ratios)) == pytest.approx(1.0, abs=0.15)


def test_points_behind_their_rays_are_left_out():
    truth, rays = truth_and_rays(1000, views=3)
    bundle = Bundle(rays, StudentT(), truth)
    opposite = replace(rays, bearings=np.where((rays.point < 50)[:, None], -rays.bearings, rays.bearings))
    with_some_behind = noise_of_map(replace(bundle, rays=opposite), truth)
    assert with_some_behind.sigma == pytest.approx(noise_of_map(bundle, truth).sigma, rel=0.05)
