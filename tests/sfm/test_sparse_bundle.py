"""Bundle adjustment by blocks of cameras, against the same problem as one dense block."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_array

from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import exp
from omnisight.optim.block_matrix import BlockPattern
from omnisight.optim.loss import StudentT
from omnisight.sfm import bundle_adjustment
from omnisight.sfm.bundle_adjustment import Bundle
from omnisight.sfm.common_points import strongly_connected_frames
from omnisight.sfm.linearized_bundle import Prior
from omnisight.sfm.measurements import MeasuredDistance, MeasuredPositions
from sfm.test_free_cameras import TRUE
from sfm.test_free_cameras import problem as problem_of_a_camera
from sfm.test_sfm_bundle_adjustment import problem

SENSORS = [Pose(), Pose(exp([0.1, 2.0, 0.3]), np.array([0.1, 0.2, -0.1]))]
FRAMES = 8


def of_neighbours(bundle: Bundle) -> Bundle:
    """Return a bundle whose points are seen from neighbouring frames only, so that distant frames have no block."""
    rays = bundle.rays
    return replace(bundle, rays=rays[(rays.frame - rays.point) % FRAMES < 4])


def rig() -> Bundle:
    truth, rays = problem(cameras=FRAMES, count=80, sensors=SENSORS)
    return of_neighbours(Bundle(rays, StudentT(), truth, has_scale=True, refines_sensors=True))


def frames() -> Bundle:
    truth, rays = problem(cameras=FRAMES, count=80)
    return of_neighbours(Bundle(rays, StudentT(), truth))


def distance() -> Bundle:
    centers = np.zeros((2, 3))
    return replace(frames(), measured=MeasuredDistance(np.array([1, 5]), centers, 3.0, 0.1))


def positions() -> Bundle:
    bundle = frames()
    places = -np.einsum("fji,fj->fi", bundle.start.rig_from_world[:, :, :3], bundle.start.rig_from_world[:, :, 3])
    known = MeasuredPositions(np.arange(FRAMES), np.zeros((FRAMES, 3)), places, np.full(3, 0.1))
    return replace(bundle, measured=known)


def free_camera() -> Bundle:
    return problem_of_a_camera(0, TRUE)


@pytest.mark.parametrize("make", [frames, rig, distance, positions, free_camera])
def test_steps_and_covariances_are_those_of_a_dense_matrix(make, monkeypatch):
    dense = make().linearize(make().start)
    monkeypatch.setattr(bundle_adjustment, "MAX_DENSE_COLUMNS", 0)
    bundle = make()
    sparse = bundle.linearize(bundle.start)
    assert len(sparse.cameras.pattern.sizes) >= 4
    np.testing.assert_allclose(sparse.reduced().matrix.toarray(), dense.reduced().matrix.toarray(), atol=1e-6)
    for damping in (0.0, 1e-2):
        step = dense.solve(damping)
        np.testing.assert_allclose(sparse.solve(damping), step, rtol=1e-6, atol=1e-5 * np.abs(step).max())
    gradients = dense.gradients()
    (expected, of_points), (found, points) = dense.covariances(gradients), sparse.covariances(gradients)
    is_known = found.pattern.addresses(*np.indices((sparse.count, sparse.count))) >= 0
    expected = expected.toarray()
    np.testing.assert_allclose(found.toarray()[is_known], expected[is_known], rtol=1e-5, atol=1e-7 * expected.max())
    np.testing.assert_allclose(points, of_points, rtol=1e-5, atol=1e-7 * np.abs(of_points).max())
    if make is not free_camera:
        assert not is_known.all()


@pytest.mark.parametrize(
    ("make", "share"), [(frames, 0.5), (rig, 0.5), (distance, 0.5), (positions, 0.5), (free_camera, 0.8)]
)
def test_steps_of_conjugate_gradients_are_those_of_a_factorization(make, share, monkeypatch):
    monkeypatch.setattr(bundle_adjustment, "MAX_DENSE_COLUMNS", 0)
    factored = make().linearize(make().start)
    monkeypatch.setattr(bundle_adjustment, "MAX_FACTORED_COLUMNS", 0)
    monkeypatch.setattr(bundle_adjustment, "STRONG_SHARE", share)
    bundle = make()
    iterative = bundle.linearize(bundle.start)
    assert bundle.divided is not None
    assert len(bundle.divided.cameras.pattern.row) < len(bundle.cameras.pattern.row)
    for damping in (0.0, 1e-2):
        step = factored.solve(damping)
        found = iterative.solve(damping)
        np.testing.assert_allclose(found, step, atol=3e-3 * np.abs(step).max())
        assert iterative.decrease(found) == pytest.approx(factored.decrease(step), rel=1e-4)


def test_frames_with_few_or_only_far_common_points_are_not_strongly_connected():
    # Frame 0 has three near points in common with frame 1, one with frame 2, and three far ones with frame 3.
    point = np.array([0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6, 6, *range(7, 12), *range(12, 17)])
    frame = np.array([0, 1, 0, 1, 0, 1, 0, 2, 0, 3, 0, 3, 0, 3, *[2] * 5, *[3] * 5])
    distance = np.where((point >= 4) & (point <= 6), 1000.0, 1.0)
    strong = strongly_connected_frames(frame, point, distance, 0.5)
    np.testing.assert_array_equal(strong, strong.T)
    assert strong[0].tolist() == [True, True, False, False]
    assert strongly_connected_frames(frame, point, distance, 0.2)[0].tolist() == [True, True, True, False]
    # Frames that see far points only are connected by them.
    far = np.full(len(point), 1000.0)
    assert strongly_connected_frames(frame, point, far, 0.2)[0].tolist() == [True, True, False, True]


def test_robust_variances_of_many_cameras_are_close_to_the_exact_ones(monkeypatch):
    bundle = frames()
    linearized = bundle.linearize(bundle.start)
    index, gradients = np.arange(linearized.count), linearized.gradients()
    exact = linearized.covariances(gradients)[0].at(index, index)
    monkeypatch.setattr("omnisight.sfm.linearized_bundle.MAX_EXACT_COLUMNS", 0)
    sampled = linearized.covariances(gradients)[0].at(index, index)
    # The standard deviation of each ratio is sqrt(2 / 512) = 0.06.
    assert not np.array_equal(sampled, exact)
    np.testing.assert_allclose(sampled / exact, 1.0, atol=0.25)


def test_a_point_at_a_camera_is_recognized():
    bundle = frames()
    assert not bundle.start.coincide_with_cameras(bundle.rays).any()
    first = bundle.start.rig_from_world[bundle.rays.frame[bundle.starts[7]]]
    points = bundle.start.points.copy()
    points[7] = -first[:, :3].T @ first[:, 3] + 1e-6
    at_camera = replace(bundle.start, points=points).coincide_with_cameras(bundle.rays)
    assert np.flatnonzero(at_camera).tolist() == [7]


def test_the_information_of_a_prior_of_few_columns_is_sparse():
    # A dense product of all columns would take 28 GB.
    prior = Prior.of(np.zeros(1), np.array([[0, 5]]), np.array([[2.0, 3.0]]), 60_000)
    pattern = BlockPattern.of_incidence(np.arange(60_001), csr_array(prior.derivatives))
    matrix, diagonal = pattern.zeros(), np.zeros(60_000)
    prior.add_information(matrix, diagonal)
    assert matrix.square(np.array([0, 5])).tolist() == [[4.0, 6.0], [6.0, 9.0]]
    assert np.flatnonzero(diagonal).tolist() == [0, 5]


def test_sparse_and_dense_priors_have_the_same_information():
    rng = np.random.default_rng(0)
    columns, derivatives = np.array([[0, 3, -1], [1, 2, 4]]), rng.normal(size=(2, 3))
    dense = Prior.of(rng.normal(size=2), columns, derivatives, 5)
    sparse = dense._replace(derivatives=csr_array(dense.derivatives))
    assert isinstance(dense.derivatives, np.ndarray)
    rows = np.zeros((2, 5))
    rows[0, [0, 3]], rows[1, [1, 2, 4]] = derivatives[0, :2], derivatives[1]
    for prior in (dense, sparse):
        matrix, diagonal = BlockPattern.dense(5).zeros(), np.zeros(5)
        prior.add_information(matrix, diagonal)
        assert np.allclose(matrix.toarray(), rows.T @ rows)
        assert np.allclose(diagonal, np.diagonal(rows.T @ rows))
