"""Triangulation from two and more rays: exact points, true covariance, and the validity of a point."""

import numpy as np
import pytest
from scenes import directions, noisy, normalized_squares, unit

import omnisight as om
from omnisight.geometry.rotation import exp


def views(seed, count, points, sigma_deg, origins=None):
    """Return poses, and noisy bearings (V, N, 3) of points seen from origins in the camera frames."""
    rng = np.random.default_rng(seed)
    poses = [om.Pose(exp(rng.normal(size=3)), rng.normal(size=3)) for _ in range(count)]
    seen = np.stack([pose @ points for pose in poses])
    bearings = unit(seen if origins is None else seen - origins)
    return poses, noisy(rng, bearings, sigma_deg)


@pytest.fixture
def points():
    return directions(np.random.default_rng(3), 400, 360) * np.random.default_rng(4).uniform(3, 9, (400, 1))


@pytest.mark.parametrize("count", [2, 3, 6])
def test_exact_rays_meet_in_the_point(points, count):
    poses, bearings = views(1, count, points, 0.0)
    found = om.triangulate(poses, bearings, sigma_deg=0.01)
    assert found.valid.mean() > 0.99
    assert np.abs(found.points - points)[found.valid].max() < 1e-6
    assert found.residual_deg[found.valid].max() < 1e-6


def test_rays_without_a_single_viewpoint_meet_in_the_point(points):
    origins = 0.1 * np.random.default_rng(5).normal(size=(3, len(points), 3))
    poses, bearings = views(2, 3, points, 0.0, origins)
    found = om.triangulate(poses, bearings, sigma_deg=0.01, origins=origins)
    assert np.abs(found.points - points)[found.valid].max() < 1e-6


@pytest.mark.parametrize("count", [2, 5])
@pytest.mark.parametrize("is_known", [True, False])
def test_covariance_is_that_of_the_errors(points, count, is_known):
    squares = []
    for seed in range(5):
        poses, bearings = views(seed, count, points, 0.1)
        found = om.triangulate(poses, bearings, sigma_deg=0.1 if is_known else None)
        use = found.valid
        squares.append(normalized_squares((found.points - points)[use], found.covariance[use], 3))
    # 2000 chi-squared variables of three degrees of freedom: the mean has the standard deviation 0.018.
    assert 0.9 < np.concatenate(squares).mean() < 1.1


def test_no_point_has_smaller_angles_to_its_rays(points):
    poses, bearings = views(7, 3, points, 0.3)
    found = om.triangulate(poses, bearings, sigma_deg=0.3)

    def cost(x):
        return sum((np.linalg.norm(unit(pose @ x) - b, axis=1) ** 2) for pose, b in zip(poses, bearings, strict=True))

    use = found.valid
    for axis in np.eye(3):
        for step in (-1e-3, 1e-3):
            assert (cost(found.points + step * axis) > cost(found.points))[use].mean() > 0.99


def test_missing_rays_parallel_rays_and_points_behind_are_not_valid():
    poses = [om.Pose(), om.Pose(translation=[-1.0, 0.0, 0.0])]
    ahead, aside = [0.0, 0.0, 1.0], unit(np.array([-1.0, 0.0, 3.0]))
    bearings = np.array([[ahead, ahead, ahead, ahead], [aside, ahead, -aside, [np.nan] * 3]])
    found = om.triangulate(poses, bearings, sigma_deg=0.1)
    assert found.valid.tolist() == [True, False, False, False]
    assert found.points[0] == pytest.approx([0, 0, 3])
    assert np.isnan(found.points[3]).all()
    assert found.parallax_deg[:2] == pytest.approx([np.degrees(np.arctan2(1, 3)), 0], abs=1e-6)


def test_cameras_that_do_not_see_a_point_change_nothing(points):
    poses = [om.Pose(translation=[-0.2 * k, 0.0, 0.0]) for k in range(2)]
    others = [om.Pose(translation=[5.0 + k, 0.0, 0.0]) for k in range(18)]
    noise = np.random.default_rng(0).normal(0, 1e-3, (2, *points.shape))
    bearings = np.stack([unit(unit(pose @ points) + e) for pose, e in zip(poses, noise, strict=True)])
    covariance = np.broadcast_to(1e-6 * np.eye(3), (2, len(points), 3, 3))
    alone = om.triangulate(poses, bearings, covariance)
    assert alone.valid.any()
    for unknown in (np.nan, 0.0):
        more = np.concatenate([bearings, np.full((18, len(points), 3), np.nan)])
        of_more = np.concatenate([covariance, np.full((18, len(points), 3, 3), unknown)])
        found = om.triangulate([*poses, *others], more, of_more)
        assert (found.valid == alone.valid).all()
        assert found.covariance == pytest.approx(alone.covariance, rel=1e-6)
    with pytest.raises(ValueError, match="covariance of a bearing that a camera sees is not finite"):
        om.triangulate(poses, bearings, np.full_like(covariance, np.nan))


def test_arrays_of_other_shapes_are_refused():
    with pytest.raises(ValueError, match="cam_from_world must hold poses"):
        om.triangulate([np.eye(4)] * 2, np.ones((2, 5, 3)))
    with pytest.raises(
        ValueError, match=r"bearings must have the shape \(V, N, 3\) with V >= 2 poses, got \(1, 5, 3\)"
    ):
        om.triangulate([om.Pose()], np.ones((1, 5, 3)))
    with pytest.raises(ValueError, match="origins must have the shape"):
        om.triangulate([om.Pose()] * 2, np.ones((2, 5, 3)), origins=np.ones((2, 4, 3)))
