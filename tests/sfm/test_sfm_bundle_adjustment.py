from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.optimize import minimize as scipy_minimize

from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import exp
from omnisight.optim.loss import StudentT
from omnisight.sfm.bundle_adjustment import Bundle, adjust_bundle
from omnisight.sfm.rig_images import RigImages
from omnisight.sfm.structure import RayObservations, Structure
from omnisight.twoview.triangulation import whitening
from sfm.worlds import circle_of_poses, observe, points_around


def problem(sigma_deg=0.1, cameras=4, count=30, seed=2, sensors=None):
    """Return the true structure and the observations of all points in all cameras; with `sensors`, in each of them."""
    poses, points = circle_of_poses(cameras), points_around(count)
    sensors = [Pose()] if sensors is None else sensors
    views = [(f, s) for f in range(cameras) for s in range(len(sensors))]
    found = observe([sensors[s] @ poses[f] for f, s in views], points, sigma_deg, seed)
    # `observe` shuffles: match points again by their descriptors.
    table = []
    for (f, s), keypoints in zip(views, found, strict=True):
        bearings = (sensors[s] @ poses[f]) @ points
        bearings /= np.linalg.norm(bearings, axis=1, keepdims=True)
        nearest = np.linalg.norm(keypoints.bearings[:, None] - bearings, axis=2).argmin(0)
        axes = whitening(keypoints.covariance)
        table += [(p, f, s, keypoints.bearings[n], axes[n]) for p, n in enumerate(nearest)]
    table.sort(key=lambda row: row[0])
    point, frame, sensor = (np.array([row[i] for row in table], np.intp) for i in range(3))
    bearings, axes = np.array([row[3] for row in table]), np.array([row[4] for row in table])
    rays = RayObservations(frame, sensor, point, np.zeros_like(bearings), bearings, axes)
    matrices = (np.array([pose.matrix for pose in each]) for each in (poses, sensors))
    return Structure(*matrices, points), rays


@pytest.mark.parametrize("refines_sensors", [False, True])
def test_derivatives_agree_with_central_differences(refines_sensors):
    sensors = [Pose(), Pose(exp([0.1, 2.0, 0.3]), np.array([0.1, 0.2, -0.1]))]
    truth, rays = problem(sensors=sensors)
    rays = RayObservations(
        rays.frame, rays.sensor, rays.point, 0.05 + np.zeros((len(rays), 3)), rays.bearings, rays.axes
    )
    bundle = Bundle(rays, StudentT(), truth, has_scale=True, refines_sensors=refines_sensors)
    linearized = bundle.linearize(truth)
    size = linearized.count + truth.points.size
    assert linearized.count == 6 * 3 + 5 * refines_sensors  # the distance of the sensors is fixed

    def residuals(step):
        return bundle.linearize(bundle.move(truth, step)).residuals

    rng = np.random.default_rng(0)
    for _ in range(5):
        direction = rng.normal(size=size) * np.where(np.arange(size) < linearized.count, 0.1, 1.0)
        numeric = (residuals(1e-6 * direction) - residuals(-1e-6 * direction)) / 2e-6
        cameras, moves = np.append(direction[: linearized.count], 0.0), direction[linearized.count :].reshape(-1, 3)
        analytic = np.einsum("mkl,ml->mk", linearized.by_camera, cameras[linearized.cameras.columns])
        analytic += np.einsum("mkc,mc->mk", linearized.by_point, moves[linearized.point])
        np.testing.assert_allclose(analytic, numeric, rtol=1e-5, atol=1e-5 * np.abs(numeric).max())


@pytest.mark.parametrize("degrees", [2.0, 1e9])
def test_refined_points_have_the_least_cost_for_their_cameras(degrees):
    """Compare with Nelder-Mead on the cost of each point, which knows neither derivatives nor weights."""
    truth, rays = problem(count=8)
    bundle = Bundle(rays, StudentT(degrees), truth)
    moved = truth.points + np.random.default_rng(3).normal(size=truth.points.shape, scale=0.05)
    refined = bundle.with_refined_points(replace(truth, points=moved))
    np.testing.assert_array_equal(refined.rig_from_world, truth.rig_from_world)
    for p, point in enumerate(refined.points):
        of_point = rays[rays.point == p]

        def cost(x, of_point=of_point):
            alone = replace(of_point, point=np.zeros(len(of_point), np.intp))
            return bundle.loss.cost(replace(truth, points=x[None]).squared_residuals(alone))

        best = scipy_minimize(cost, point, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12})
        assert cost(point) <= best.fun + 1e-5 * max(best.fun, 1e-3)
        assert cost(point) < cost(moved[p])


def test_wrong_initial_poses_and_points_lead_to_the_optimum():
    truth, rays = problem(cameras=12, count=200)
    rng, bundle = np.random.default_rng(5), Bundle(rays, StudentT(), truth)
    best = adjust_bundle(bundle)
    poses = truth.rig_from_world.copy()
    poses[1:, :, :3] = exp(np.radians(2) * rng.normal(size=(11, 3))) @ poses[1:, :, :3]
    points = truth.points * (1 + 0.2 * rng.normal(size=(200, 1)))
    start = replace(truth, rig_from_world=poses, points=points)
    found = adjust_bundle(replace(bundle, start=start))
    assert bundle.cost(start) > 100 * best.cost
    assert found.cost == pytest.approx(best.cost, rel=1e-4)


def test_a_step_solves_the_normal_equations():
    truth, rays = problem()
    bundle = Bundle(rays, StudentT(), truth)
    linearized = bundle.linearize(truth)
    count, size = linearized.count, linearized.count + truth.points.size
    jacobian = np.zeros((len(rays), 2, size + 1))
    for i in range(len(rays)):
        np.add.at(jacobian[i].T, linearized.cameras.columns[i], linearized.by_camera[i].T)
        jacobian[i, :, count + 3 * rays.point[i] : count + 3 * rays.point[i] + 3] = linearized.by_point[i]
    # Fixed parameters have the column -1, which is the last.
    assert (linearized.cameras.columns < 0).any()
    jacobian = jacobian.reshape(-1, size + 1)[:, :-1]
    residuals = linearized.residuals.ravel()
    step = linearized.solve(0.0)
    expected = np.linalg.lstsq(jacobian, -residuals)[0]
    np.testing.assert_allclose(step, expected, rtol=1e-5, atol=1e-8 * np.abs(expected).max())
    decrease = 0.5 * (residuals**2).sum() - 0.5 * ((residuals + jacobian @ step) ** 2).sum()
    assert linearized.decrease(step) == pytest.approx(decrease)
    cameras, points = linearized.covariances()
    covariance = np.linalg.inv(jacobian.T @ jacobian)
    cameras = cameras.toarray()
    np.testing.assert_allclose(cameras, covariance[:count, :count], rtol=1e-5, atol=1e-9 * np.abs(cameras).max())
    np.testing.assert_allclose(points[7], covariance[count + 21 : count + 24, count + 21 : count + 24], rtol=1e-5)


def test_the_optimum_is_that_of_scipy_also_with_outliers():
    truth, rays = problem(count=8)
    bearings = rays.bearings.copy()
    bearings[::17] = -bearings[::17][:, [1, 2, 0]]
    rays = RayObservations(rays.frame, rays.sensor, rays.point, rays.origins, bearings, rays.axes)
    bundle = Bundle(rays, StudentT(2.0, np.sqrt(2.0)), truth)
    found = adjust_bundle(bundle, tolerance=1e-14).state

    def whitened(step):
        return np.sqrt(bundle.move(truth, step).squared_residuals(rays))

    size = bundle.parameters[2] + truth.points.size
    usable = np.isfinite(whitened(np.zeros(size)))
    reference = least_squares(
        lambda step: np.where(usable, whitened(step), 0.0), np.zeros(size), loss="cauchy", f_scale=2.0, xtol=1e-15
    )
    lost = 0.5 * 4 * np.log1p(1e4) * (~usable).sum()
    assert bundle.cost(found) <= (reference.cost + lost) * (1 + 1e-6)


def mean_squared_errors(seeds, count=25, overstated=1.0):
    """Return the means of the squared errors of poses and points over their covariances.

    The stated standard deviations of every other point are too small by a factor.
    """
    of_poses, of_points = [], []
    for seed in seeds:
        truth, rays = problem(sigma_deg=0.05, cameras=3, count=count, seed=seed)
        factor = np.where(rays.point % 2 == 1, overstated, 1.0)
        bundle = Bundle(replace(rays, axes=rays.axes * factor[:, None, None]), StudentT(), truth)
        found = adjust_bundle(bundle).state
        cameras, points = bundle.covariances(found)
        frames, _, free = bundle.parameters
        step = np.zeros(free + 1)
        turns = found.rig_from_world[:, :, :3] @ truth.rig_from_world[:, :, :3].transpose(0, 2, 1)
        small = np.stack([turns[:, 2, 1], turns[:, 0, 2], turns[:, 1, 0]], axis=1)
        moves = found.rig_from_world[:, :, 3] - truth.rig_from_world[:, :, 3]
        step[frames] = np.hstack([small, moves])
        of_poses.append(step[:free] @ np.linalg.solve(cameras.toarray(), step[:free]) / free)
        error = (found.points - truth.points)[:, :, None]
        of_points.append((error * np.linalg.solve(points, error)).sum(axis=(1, 2)).mean() / 3)
    return np.mean(of_poses), np.mean(of_points)


def test_covariances_agree_with_monte_carlo():
    assert mean_squared_errors(range(40)) == pytest.approx((1.0, 1.0), abs=0.2)


def test_covariances_are_true_for_points_of_unknown_accuracy():
    """The stated variances alone would be too small by factors of up to 9."""
    assert mean_squared_errors(range(40), count=200, overstated=3.0) == pytest.approx((1.0, 1.0), abs=0.4)


def test_rays_of_keypoints_are_white():
    keypoints = observe(circle_of_poses(2), points_around(50), 0.1)
    rays = RigImages.of(keypoints)
    white = rays.axes @ np.concatenate([k.covariance for k in keypoints]) @ rays.axes.transpose(0, 2, 1)
    np.testing.assert_allclose(white, np.tile(np.eye(2), (100, 1, 1)), atol=1e-9)
