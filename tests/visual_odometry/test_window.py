"""Cells of equal solid angle, and the prior that marginalization leaves."""

import numpy as np
import pytest

import omnisight as om
from omnisight.geometry import rotation as so3
from omnisight.optim.levenberg_marquardt import minimize
from omnisight.optim.loss import StudentT
from omnisight.sfm.bundle_adjustment import Bundle
from omnisight.sfm.structure import RayObservations, Structure
from omnisight.visual_odometry._whitened_axes_kernel import whitened_axes
from omnisight.visual_odometry.marginalization import PosePrior, gauge_prior, marginalize_first
from omnisight.visual_odometry.solid_angle_cells import SolidAngleCells


@pytest.mark.parametrize("camera", [om.sphere(256), om.fisheye(200, 200)], ids=["sphere", "fisheye"])
def test_cells_have_the_same_solid_angle(camera):
    """Not the same number of pixels: a 360 image has as many at a pole as at the horizon."""
    cells = SolidAngleCells.of(camera, np.ones((camera.height, camera.width), bool), 100)
    assert 70 < cells.used < 150
    rng = np.random.default_rng(0)
    bearings = rng.normal(size=(40000, 3))
    pixels, valid = camera.project(bearings)
    found = cells.at(pixels[valid & camera.in_image(pixels)])
    counts = np.bincount(found[found >= 0], minlength=cells.count)
    counts = counts[counts > 0]
    assert np.quantile(counts, 0.9) < 1.6 * np.quantile(counts, 0.1) if camera.model.period else 3 * np.median(counts)


def bundle(noise=0.0):
    """Return the problem of four frames that see thirty points around them."""
    rng = np.random.default_rng(1)
    points = 4 * rng.normal(size=(30, 3))
    poses = [om.Pose(so3.exp(0.1 * rng.normal(size=3)), rng.normal(size=3)) for _ in range(4)]
    frame, point = np.tile(np.arange(4), 30), np.repeat(np.arange(30), 4)
    seen = np.stack([poses[f] @ points[p] for f, p in zip(frame, point, strict=True)])
    bearings = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    first = np.cross(bearings, np.roll(bearings, 1, axis=1))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    axes = np.stack([first, np.cross(bearings, first)], axis=1) / 1e-3
    bearings = bearings + noise * np.einsum("nij,ni->nj", axes * 1e-3, rng.normal(size=(120, 2)))
    axes -= np.einsum("nij,nj,nk->nik", axes, bearings, bearings)
    rays = RayObservations(frame, np.zeros(120, np.intp), point, np.zeros((120, 3)), bearings, axes)
    matrices = np.array([pose.matrix for pose in poses])
    prior = gauge_prior(matrices[:2], 1e-3, has_scale=False)
    start = Structure(matrices, np.eye(3, 4)[None], points)
    return Bundle(rays, StudentT(), start, measured=prior), prior


def test_marginalization_keeps_the_optimum_and_the_information_of_the_other_poses():
    full, prior = bundle(noise=1e-3)
    optimum = minimize(full, full.start, iterations=50, tolerance=1e-14).state
    at_optimum = Bundle(full.rays, full.loss, optimum, measured=prior)
    kept = marginalize_first(at_optimum, prior)
    rows = kept.derivatives.reshape(len(kept.residuals), -1)
    assert np.abs(rows.T @ kept.residuals).max() < 1e-3 * np.abs(rows.T @ rows).max()
    weights = np.full(len(full.rays.frame), full.loss.information)
    cameras, _ = at_optimum.linearize(optimum, weights).covariances()
    assert np.allclose(np.linalg.inv(rows.T @ rows), cameras.toarray()[6:, 6:], rtol=1e-4, atol=1e-9)


def test_the_gauge_prior_keeps_the_first_pose_and_the_distance_of_the_second():
    full, prior = bundle()
    assert np.allclose(prior.linearize(full.start.rig_from_world).residuals, 0)
    moved = full.start.rig_from_world.copy()
    center = om.Pose.of_matrix(moved[1]).inverse().translation
    first = om.Pose.of_matrix(moved[0]).inverse().translation
    longer = first + 1.01 * (center - first)
    moved[1, :, 3] = -moved[1, :, :3] @ longer
    residuals = prior.linearize(moved).residuals
    assert np.allclose(residuals[:6], 0)
    assert np.isclose(residuals[6], 0.01 * np.linalg.norm(center - first) / 1e-3, rtol=1e-6)


def test_information_that_is_only_rounding_is_unknown():
    """The Schur complement of an unobserved direction can be slightly negative."""
    information = np.diag([4.0, 9.0, 1.0, 4.0, 16.0, -1e-18])
    information[0, 5] = information[5, 0] = 1e-9
    prior = PosePrior.of_normal_equations(np.arange(1), np.eye(3, 4)[None], information, np.ones(6))
    rows = prior.derivatives[:, 0]
    assert np.allclose(rows.T @ rows, np.diag([4.0, 9.0, 1.0, 4.0, 16.0, 0.0]), atol=1e-8)


def test_axes_whiten_the_covariance_of_a_bearing():
    """The covariance of pixels A N A^T + v I, through the pixels per radian of a patch."""
    rng = np.random.default_rng(0)
    maps, units, bearings = rng.normal(size=(20, 2, 5)), rng.normal(size=(20, 3, 2)), rng.normal(size=(20, 3))
    bearings /= np.linalg.norm(bearings, axis=1, keepdims=True)
    root, variance = rng.normal(size=(20, 2, 2)), rng.uniform(0.1, 1.0, 20)
    maps[3] = np.nan
    axes = np.empty((20, 2, 3))
    whitened_axes(maps, units, bearings, root @ root.transpose(0, 2, 1), variance, axes)
    assert np.isnan(axes[3]).all()
    for n in [*range(3), *range(4, 20)]:
        a, b = maps[n, :, :2], bearings[n]
        px_per_rad = a @ np.linalg.pinv(units[n] - np.outer(b, b @ units[n]))
        covariance = a @ root[n] @ root[n].T @ a.T + variance[n] * np.eye(2)
        assert np.allclose(axes[n].T @ axes[n], px_per_rad.T @ np.linalg.inv(covariance) @ px_per_rad)
