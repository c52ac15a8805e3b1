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
    rng = np.random.default_rng(seed)
    frame = np.argsort(rng.random((count, 6)), axis=1)[:, :views].ravel()
    return observed(points_around(count), frame, np.repeat(np.arange(count), views), rng, stated)


def two_groups(joint, seed, count=300):
    """Return the true structure of two groups of three cameras, and rays: a number of points is seen from both."""
    rng = np.random.default_rng(seed)
    of_joint = np.column_stack([rng.integers(3, size=joint), 3 + rng.integers(3, size=joint)])
    group = 3 * rng.integers(2, size=count - joint)
    frame = np.append(of_joint.ravel(), (group[:, None] + np.arange(3)).ravel())
    point = np.append(np.repeat(np.arange(joint), 2), np.repeat(np.arange(joint, count), 3))
    return observed(points_around(count, seed), frame, point, rng)


def observed(points, frame, point, rng, stated=1.0):
    """Return the structure of points and six cameras, and rays with normal errors and their stated covariance."""
    matrices = np.array([pose.matrix for pose in circle_of_poses(6)])
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


def squared_errors(bundle, state):
    """Return the squared errors (F, 6) of the steps of poses over their stated variances; NaN if they are fixed."""
    variances, columns = bundle.covariances(state)[0].diagonal(), bundle.parameters[0]
    pairs = zip(bundle.start.rig_from_world, state.rig_from_world, strict=True)
    steps = np.array([Pose.of_matrix(true).step_to(Pose.of_matrix(found)) for true, found in pairs])
    return np.where(columns >= 0, steps**2 / variances[columns], np.nan)


@pytest.mark.parametrize("views", [2, 4])
def test_errors_of_poses_have_the_stated_variances(views):
    ratios = [squared_errors(*adjusted(*truth_and_rays(300, views=views, seed=seed))) for seed in range(30)]
    assert np.sqrt(np.nanmean(ratios)) == pytest.approx(1.0, abs=0.15)


def test_errors_of_poses_have_the_stated_variances_where_few_points_connect_two_groups():
    """The cameras absorb a large part of the residuals of such points."""
    bundles = [Bundle(rays, StudentT(), truth) for truth, rays in (two_groups(12, seed) for seed in range(60))]
    ratios = [squared_errors(bundle, adjust_bundle(bundle).state)[3:] for bundle in bundles]
    assert np.sqrt(np.median(np.nanmean(ratios, axis=(1, 2)))) == pytest.approx(1.0, abs=0.25)


def test_points_behind_their_rays_are_left_out():
    truth, rays = truth_and_rays(1000, views=3)
    bundle = Bundle(rays, StudentT(), truth)
    opposite = replace(rays, bearings=np.where((rays.point < 50)[:, None], -rays.bearings, rays.bearings))
    with_some_behind = noise_of_map(replace(bundle, rays=opposite), truth)
    assert with_some_behind.sigma == pytest.approx(noise_of_map(bundle, truth).sigma, rel=0.05)
