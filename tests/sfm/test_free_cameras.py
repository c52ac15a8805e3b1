"""Bundle adjustment of cameras whose calibration is unknown or uncertain."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

import omnisight as om
from every_model import EXAMPLES
from omnisight.camera import Camera
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import exp
from omnisight.models.kannala_brandt import KannalaBrandt
from omnisight.optim.loss import StudentT
from omnisight.sfm.bundle_adjustment import Bundle, adjust_bundle
from omnisight.sfm.calibration_check import focal_length_changes, scaling_basis
from omnisight.sfm.mapping import map_images
from omnisight.sfm.pixel_rays import FreeCameras, PixelRays, residual_derivatives
from omnisight.sfm.registration import register_frames
from omnisight.sfm.rig_images import RigImages
from omnisight.sfm.structure import RayObservations, Structure
from omnisight.sfm.view_graph import match_pairs
from omnisight.twoview.triangulation import whitening
from sfm.worlds import circle_of_poses, observe, points_around, similarity_errors, unit

TRUE = Camera(KannalaBrandt(fx=300.0, fy=300.0, cx=400.0, cy=390.0, k1=0.02, k2=0.0, k3=0.0, k4=0.0), (800, 800))
GROUPS = {("fx", "fy"): np.inf, ("k1",): np.inf}
NOISE_PX = 0.3


def problem(seed, start, sigmas=None, world=None):
    """Return the bundle of noisy pixels of the poses and points of a world, whose rays are those of another camera."""
    rng = np.random.default_rng(seed)
    poses, points = world or (circle_of_poses(5), points_around(60, seed=seed))
    rows = []
    for n, point in enumerate(points):
        for f, pose in enumerate(poses):
            bearing = unit(pose @ point)
            if bearing[2] > -0.2:
                rows.append((n, f, TRUE.project(bearing)[0] + rng.normal(0, NOISE_PX, 2)))
    point, frame = (np.array([row[i] for row in rows], np.intp) for i in range(2))
    pixels, sensor = np.array([row[2] for row in rows]), np.zeros(len(rows), np.intp)
    free = FreeCameras.of_parameters([start], [sigmas or GROUPS])
    bearings, _, by_pixel, _ = start.model.unproject_with_jacobians(pixels)
    axes = whitening(NOISE_PX**2 * by_pixel @ by_pixel.transpose(0, 2, 1))
    rays = RayObservations(frame, sensor, point, np.zeros_like(bearings), bearings, axes)
    matrices = np.array([pose.matrix for pose in poses]), Pose().matrix[None]
    truth = Structure(*matrices, points, np.zeros(free.count))
    return Bundle(rays, StudentT(), truth, pixels=PixelRays.of(free, sensor, pixels, axes))


@pytest.mark.parametrize("model", EXAMPLES)
def test_derivatives_of_residuals_by_the_parameters_agree_with_differences(model):
    rng = np.random.default_rng(0)
    pixels = rng.uniform(0.3, 0.7, (40, 2)) * 960
    bearings, valid = model.unproject(pixels)
    pixels, bearings = pixels[valid], bearings[valid]
    directions = unit(bearings + rng.normal(0, 0.05, bearings.shape))

    def residuals(params):
        changed = model.with_params(params)
        by_point = changed.project_with_jacobians(changed.unproject(pixels)[0])[2]
        return np.einsum("nij,nj->ni", by_point, directions)

    analytic = residual_derivatives(model, pixels, directions)
    for i, value in enumerate(model.params):
        step = np.zeros(len(model.params))
        step[i] = 1e-5 * abs(value) or 1e-7
        numeric = (residuals(model.params + step) - residuals(model.params - step)) / (2 * step[i])
        np.testing.assert_allclose(analytic[:, :, i], numeric, atol=1e-4 * np.abs(analytic[:, :, i]).max() + 1e-6)


def test_the_gradient_is_that_of_the_cost():
    bundle = problem(0, TRUE, {**GROUPS, ("cx",): 1.0})
    linearized = bundle.linearize(bundle.start)
    gradient = np.einsum("mkl,mk->l", linearized.by_camera, linearized.residuals)
    step = np.zeros(linearized.count + bundle.start.points.size)
    for column, size in zip(range(-3, 0), (1e-3, 1e-6, 1e-4), strict=True):
        step[linearized.count + column] = size
        numeric = np.diff([bundle.cost(bundle.move(bundle.start, sign * step)) for sign in (-1, 1)])[0] / (2 * size)
        assert gradient[column] == pytest.approx(numeric, rel=1e-3)
        step[linearized.count + column] = 0.0


def drive(seed):
    """Return the poses of a straight drive, and points beside the road."""
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(-8, 8, 400), rng.uniform(-4, 1, 400), rng.uniform(2, 30, 400)])
    return [Pose(np.eye(3), np.array([0.0, 0.0, -2.0 * k])) for k in range(6)], points[np.abs(points[:, 0]) > 2]


@pytest.mark.slow
def test_the_focal_length_of_a_straight_drive_has_no_bias():
    """Larger images have larger residuals: without this part of the gradient, it was several sigmas too long."""
    errors = []
    for seed in range(25):
        bundle = problem(seed, TRUE, {("fx", "fy"): np.inf}, drive(1000 + seed))
        found = adjust_bundle(bundle).state
        sigma = np.sqrt(bundle.covariances(found)[0].diagonal()[-1])
        errors.append(found.values[0] / sigma)
    assert abs(np.mean(errors)) < 0.6  # 0.2 (1 sigma)
    assert 0.6 < np.std(errors) < 1.4


@pytest.mark.parametrize("factor", [0.97, 1.03])
def test_the_optimum_does_not_depend_on_the_start(factor):
    bundle = problem(3, TRUE, {("fx", "fy"): np.inf}, drive(1003))
    near = adjust_bundle(bundle)
    start = replace(bundle.start, values=np.array([300.0 * (factor - 1)]))
    far = adjust_bundle(replace(bundle, start=start))
    sigma = np.sqrt(bundle.covariances(near.state)[0].diagonal()[-1])
    assert far.state.values[0] == pytest.approx(near.state.values[0], abs=0.2 * sigma)


def test_focal_length_and_distortion_are_estimated():
    start = replace(TRUE, model=replace(TRUE.model, fx=320.0, fy=320.0, k1=0.0))
    bundle = problem(1, start)
    found = adjust_bundle(bundle).state
    (camera,) = bundle.pixels.free.at(found.values)
    assert camera.model.fx == camera.model.fy == pytest.approx(300.0, abs=0.3)
    assert camera.model.k1 == pytest.approx(0.02, abs=1e-3)


def test_covariances_of_cameras_agree_with_monte_carlo():
    squares = []
    for seed in range(40):
        bundle = problem(seed, TRUE)
        found = adjust_bundle(bundle).state
        cameras, _ = bundle.covariances(found)
        squares.append(found.values @ np.linalg.solve(cameras.toarray()[-2:, -2:], found.values) / 2)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.4)


def test_a_prior_holds_what_the_images_do_not_determine():
    free = problem(2, TRUE, {**GROUPS, ("k4",): 1e-7})
    found = adjust_bundle(free).state
    assert abs(found.values[2]) < 1e-7
    cameras, _ = free.covariances(found)
    assert np.sqrt(cameras.toarray()[-1, -1]) == pytest.approx(1e-7, rel=0.15)


@pytest.mark.parametrize("camera", [TRUE, om.perspective((600, 400), 70), om.sphere(640)], ids=lambda c: c.model.name)
def test_the_basis_of_a_camera_scales_its_image(camera):
    basis = scaling_basis(camera)
    if camera.model.name == "equirectangular":  # always 360 degrees wide
        assert basis is None
        return
    scaled = camera.model.with_params(camera.model.params + 0.01 * basis[:, 0])
    pixels = np.random.default_rng(0).uniform(100, 300, (50, 2))
    center = np.array([camera.model.cx, camera.model.cy])
    bearings, _ = scaled.unproject(center + 1.01 * (pixels - center))
    np.testing.assert_allclose(bearings, camera.model.unproject(pixels)[0], atol=1e-3)


def seen(poses, points, camera, sigma_px):
    """Return keypoints whose pixels are those of the true camera, and whose bearings are those of another."""
    found = []
    for exact in observe(poses, points, 1e-9):
        rng, bearings = np.random.default_rng(len(found)), exact.bearings
        exact = exact[bearings[:, 2] > 0]
        pixels = TRUE.project(exact.bearings)[0] + rng.normal(0, sigma_px, (len(exact), 2))
        bearings, _, by_pixel, _ = camera.model.unproject_with_jacobians(pixels)
        covariance = sigma_px**2 * by_pixel @ by_pixel.transpose(0, 2, 1)
        found.append(replace(exact, pixels=pixels, bearings=bearings, covariance=covariance))
    return found


@pytest.mark.parametrize("scale", [1.0, 1.04])
def test_a_focal_length_that_the_images_contradict_is_reported(scale):
    model = replace(TRUE.model, fx=TRUE.model.fx * scale, fy=TRUE.model.fy * scale)
    camera, points = replace(TRUE, model=model), points_around(600)
    centers = np.random.default_rng(4).uniform(-0.7, 0.7, (8, 3))
    keypoints = seen([Pose(np.eye(3), -center) for center in centers], points, camera, 0.3)
    graph = match_pairs(keypoints, list(combinations(range(8), 2)), lambda *_: None)
    (found,) = map_images(keypoints, RigImages.of(keypoints), graph, lambda *_: None)
    (change,) = focal_length_changes(found, [camera], keypoints)
    assert change.is_suspicious == (scale > 1)
    assert change.relative == pytest.approx(1 / scale - 1, abs=4 * change.sigma + 0.25 * (scale - 1))


def test_the_covariance_of_a_calibration_is_the_prior_of_its_refinement():
    covariance = np.diag([4.0, 4.0, 1.0, 1.0, 1e-6, 0.0, 0.0, 0.0])
    covariance[0, 1] = covariance[1, 0] = 3.9
    free = FreeCameras.of_calibrations([replace(TRUE, covariance=covariance)])
    of_params = free.bases[0] @ np.diag(1 / free.precision) @ free.bases[0].T
    np.testing.assert_allclose(of_params, covariance, atol=1e-12)
    with pytest.raises(ValueError, match="has no covariance"):
        FreeCameras.of_calibrations([TRUE])


def test_images_are_registered_by_the_refined_cameras():
    start = replace(TRUE, model=replace(TRUE.model, fx=345.0, fy=345.0))
    poses = [Pose(exp(np.array([0.0, 0.05 * k, 0.0])), -np.array([0.4 * k, 0.1 * k * k, 0.0])) for k in range(6)]
    keypoints = seen(poses, points_around(600), start, NOISE_PX)
    free = FreeCameras.of_parameters([start], [GROUPS])
    images = RigImages.of(keypoints).with_free_cameras(free, keypoints)
    graph = match_pairs(keypoints, list(combinations(range(6), 2)), lambda *_: None)
    five = graph.without_images(np.arange(6) == 5)
    (found,) = map_images(keypoints, images, five, lambda *_: None)
    assert found.cameras[0].model.fx == pytest.approx(300, abs=5)
    none = np.zeros(0, np.intp)
    frames, registered, _ = register_frames(replace(found, graph=graph), five.edges, none, keypoints)
    assert frames.tolist() == [5]
    order = np.argsort(found.frames)
    positions, _ = similarity_errors([*found.rig_from_world[order], *registered], poses)
    assert positions[5] < 0.01
