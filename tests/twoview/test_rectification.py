"""Rectification and dense stereo, against the geometry of points and rendered pairs."""

import numpy as np
import pytest

import omnisight as om
from omnisight.geometry import rotation as so3
from omnisight.images import to_gray8
from omnisight.simulation import Renderer, fisheye_setup, mirror_setup, scene_named
from omnisight.twoview.dense_stereo import dense_stereo, distances, match_rows
from omnisight.twoview.rectification import MAX_LATITUDE

SPHERE, FISHEYE, MIRROR = om.sphere(400), om.fisheye(300, 190), mirror_setup(360).camera
POSES = {
    "sideways": om.Pose(np.eye(3), np.array([-0.2, 0.0, 0.0])),
    "to the left": om.Pose(np.eye(3), np.array([0.2, 0.01, 0.0])),
    "forward": om.Pose(so3.exp([0.0, 0.1, 0.0]), np.array([0.0, 0.0, -0.3])),
    "turned": om.Pose(so3.exp([0.3, 1.2, -0.4]), np.array([0.3, 0.2, -0.1])),
    "opposite": om.Pose(so3.exp([0.0, np.pi, 0.0]), np.array([0.0, 0.0, -0.1])),
}
CAMERAS = {
    "spheres": (SPHERE, SPHERE),
    "fisheyes": (FISHEYE, FISHEYE),
    "mirrors": (MIRROR, MIRROR),
    "fisheye and mirror": (FISHEYE, MIRROR),
}


def random_points(count=500):
    """Return points all around, also behind the cameras, from 1 to 50 away."""
    rng = np.random.default_rng(4)
    directions = rng.normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True) * np.geomspace(1, 50, count)[:, None]


def in_rectified(rectification, pose, points):
    """Return the pixels of points of frame a in both rectified images."""
    in_a = rectification.camera.project(points @ rectification.rectified_from_a.T)[0]
    in_b = rectification.camera.project((pose @ points) @ rectification.rectified_from_b.T)[0]
    return in_a, in_b


@pytest.mark.parametrize("pose", POSES.values(), ids=POSES)
@pytest.mark.parametrize("cameras", CAMERAS.values(), ids=CAMERAS)
def test_rows_are_epipolar_for_points_all_around(cameras, pose):
    if pose is POSES["opposite"] and FISHEYE in cameras:
        cameras = (om.fisheye(300, 220), om.fisheye(300, 220))
    rectification = om.rectify(cameras, pose, 1.0)
    points = random_points()
    assert (points[:, 2] < 0).mean() > 0.4
    in_a, in_b = in_rectified(rectification, pose, points)
    difference = in_a - in_b
    period = 2 * np.pi * rectification.camera.model.fy
    across = difference[:, 1] - period * np.round(difference[:, 1] / period)
    assert np.abs(across).max() < 1e-6
    assert (difference[:, 0] > 0).all()
    # Independent of the projection: the angles of a triangle of known sides, from the law of cosines.
    a, b = np.linalg.norm(points, axis=1), np.linalg.norm(pose @ points, axis=1)
    baseline = np.linalg.norm(pose.translation)
    alpha = np.arccos((a**2 + baseline**2 - b**2) / (2 * a * baseline))
    parallax = np.arccos((a**2 + b**2 - baseline**2) / (2 * a * b))
    np.testing.assert_allclose(rectification.angles(in_a[:, 0]), alpha, atol=1e-9)
    np.testing.assert_allclose(difference[:, 0] / rectification.px_per_rad, parallax, atol=1e-7)
    assert difference[:, 0].max() <= rectification.max_disparity


@pytest.mark.parametrize("pose", POSES.values(), ids=POSES)
def test_row_differences_of_bearings_are_zero_and_parallax_positive(pose):
    rectification = om.rectify((SPHERE, SPHERE), pose, 1.0)
    points = random_points()
    parallax, across = rectification.differences(points, pose @ points).T
    assert np.abs(across).max() < 1e-9
    assert (parallax > 0).all()
    # Bearings perpendicular to the baseline that are turned about it deviate by this angle.
    axis = rectification.rectified_from_a[0]
    across_baseline = points[np.abs(points @ axis) < 0.1 * np.linalg.norm(points, axis=1)]
    assert len(across_baseline) > 20
    deviation = rectification.differences(across_baseline @ so3.exp(0.01 * axis).T, pose @ across_baseline)[:, 1]
    np.testing.assert_allclose(np.abs(deviation), 0.01, rtol=0.05)


def test_rectified_frames_have_x_along_the_baseline_and_look_between_the_cameras():
    pose = om.Pose(so3.exp([0.0, 0.4, 0.0]), so3.exp([0.0, 0.4, 0.0]) @ [-1.0, 0.0, 0.0])
    rectification = om.rectify((FISHEYE, FISHEYE), pose, 3.0)
    for rotation in (rectification.rectified_from_a, rectification.rectified_from_b):
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1)
    np.testing.assert_allclose(rectification.rectified_from_a, np.eye(3), atol=1e-12)
    assert rectification.baseline == pytest.approx(1)


def test_common_field_of_view_decides_size_and_resolution():
    camera = om.perspective((300, 200), 60)
    view = om.rectify((camera, camera), POSES["sideways"], 1.0).camera
    whole = om.rectify((SPHERE, SPHERE), POSES["sideways"], 1.0)
    assert whole.is_periodic
    assert view.height < 300
    assert view.width < 480
    assert view.model.fx == pytest.approx(300 / 2 / np.tan(np.radians(30)), rel=0.2)
    # All directions that the camera sees are in the rectified image.
    rotated = camera.samples()[0]
    assert view.in_image(view.project(rotated)[0]).all()
    assert whole.camera.width == pytest.approx(2 * MAX_LATITUDE * whole.px_per_rad, abs=1)
    assert whole.camera.height == pytest.approx(400, rel=0.02)
    half = np.zeros((200, 300), bool)
    half[:100] = True
    masked = om.rectify((camera, camera), POSES["sideways"], 1.0, (half, None)).camera
    assert masked.height == pytest.approx(view.height / 2, rel=0.1)


def test_remap_shows_a_point_in_its_row_and_column():
    rectification = om.rectify((SPHERE, SPHERE), POSES["turned"], 1.0)
    point = np.array([0.4, 0.3, -2.0])
    for which, at in enumerate((point, POSES["turned"] @ point)):
        image = np.zeros((200, 400), np.uint8)
        (u, v), _ = SPHERE.project(at)
        rows, columns = np.mgrid[:200, :400]
        image[(rows - v) ** 2 + (columns - u) ** 2 < 9] = 255
        rectified, seen = rectification.remap(image, which)
        assert seen.all()
        centre = np.argwhere(rectified > 128).mean(0)[::-1]
        np.testing.assert_allclose(centre, in_rectified(rectification, POSES["turned"], point)[which], atol=1)


@pytest.mark.parametrize(
    ("pose", "min_distance", "message"),
    [
        (om.Pose(), 1.0, "the baseline is 0: stereo needs two cameras in different places"),
        (om.Pose(np.eye(3), np.array([np.nan, 0, 0])), 1.0, "the baseline is nan"),
        (POSES["sideways"], np.inf, "the smallest distance is inf, but must be finite"),
        (POSES["sideways"], np.nan, "the smallest distance is nan, but must be finite"),
        (POSES["sideways"], 0.1, "the smallest distance is 0.1, but must be larger than the baseline, which is 0.2"),
    ],
)
def test_unusable_geometry_is_refused(pose, min_distance, message):
    with pytest.raises(ValueError, match=message):
        om.rectify((SPHERE, SPHERE), pose, min_distance)


def test_cameras_that_see_nothing_in_common_are_refused():
    camera = om.perspective((300, 200), 60)
    with pytest.raises(ValueError, match="see no common direction"):
        om.rectify((camera, camera), om.Pose(so3.exp([0.0, np.pi, 0.0]), np.array([0.2, 0.0, 0.0])), 1.0)


# -- disparities and distances -----------------------------------------------------------------------------------


@pytest.mark.parametrize("pose", POSES.values(), ids=POSES)
def test_distances_of_exact_disparities(pose):
    rectification = om.rectify((SPHERE, SPHERE), pose, 1.0)
    points = random_points()
    in_a, in_b = in_rectified(rectification, pose, points)
    # One row of the image per point: its disparity is in the column nearest to it, and belongs to that column.
    columns = np.clip(np.rint(in_a[:, 0]).astype(int), 0, rectification.camera.width - 1)
    exact = np.abs(in_a[:, 0] - columns) < 0.5
    bearings = rectification.camera.unproject(np.stack([columns, in_a[:, 1]], -1))[0] @ rectification.rectified_from_a
    moved = bearings * np.linalg.norm(points, axis=1, keepdims=True)
    in_a, in_b = in_rectified(rectification, pose, moved)
    disparity = np.full((len(points), rectification.camera.width), np.nan)
    disparity[np.arange(len(points)), columns] = in_a[:, 0] - in_b[:, 0]
    found, sigma = (
        values[np.arange(len(points)), columns][exact] for values in distances(rectification, disparity, 0.25)
    )
    assert exact.sum() > 400
    np.testing.assert_allclose(found, np.linalg.norm(points, axis=1)[exact], rtol=2e-5)
    # The standard deviation is the change by a small change of the disparity.
    changed, _ = distances(rectification, disparity + 1e-3, 0.25)
    slope = np.abs(changed[np.arange(len(points)), columns][exact].astype(float) - found) / 1e-3
    near = found < 5
    assert near.sum() > 100
    np.testing.assert_allclose(sigma[near], 0.25 * slope[near], rtol=0.05)


def test_uncertainty_grows_toward_the_epipoles_and_disparities_without_a_point_have_no_distance():
    rectification = om.rectify((SPHERE, SPHERE), POSES["sideways"], 1.0)
    width = rectification.camera.width
    alpha = rectification.angles(np.arange(width))
    at_two = np.arctan2(0.2 * np.sin(alpha), 2 - 0.2 * np.cos(alpha)) * rectification.px_per_rad
    distance, sigma = distances(rectification, at_two[None], 0.3)
    np.testing.assert_allclose(distance, 2, rtol=1e-5)
    beyond = np.abs(np.degrees(alpha) - 90) > 20
    assert (np.diff(sigma[0])[beyond[1:] & (alpha[1:] < np.pi / 2)] > 0).all()
    assert (np.diff(sigma[0])[beyond[1:] & (alpha[1:] > np.pi / 2)] < 0).all()
    assert sigma[0, [0, -1]].min() > 4 * sigma[0, width // 2]
    assert np.isnan(distances(rectification, np.array([[0.0, -1.0, np.nan]]), 0.3)[0]).all()


def noise_sphere(width=400):
    """Return a 360 image of blobs that continues over its seam."""
    import cv2

    rng = np.random.default_rng(1)
    noise = cv2.GaussianBlur(np.tile(rng.uniform(0, 255, (width // 2, width)).astype(np.float32), (1, 3)), (0, 0), 1.5)
    return np.clip(128 + 5 * (noise[:, width : 2 * width] - 128), 0, 255).astype(np.uint8)


def test_disparities_have_no_seam_and_none_where_a_camera_sees_nothing():
    # Equal images are those of points at infinity: their disparity is zero all around the baseline.
    mask = np.ones((200, 400), bool)
    mask[:, 100:160] = False
    rectification = om.rectify((SPHERE, SPHERE), POSES["sideways"], 1.0, (mask, None))
    assert rectification.is_periodic
    image = noise_sphere()
    (a, seen_a), (b, seen_b) = (rectification.remap(image, which) for which in (0, 1))
    disparity = match_rows(rectification, (a, b), (seen_a, seen_b))
    assert not np.isfinite(disparity[~seen_a]).any()
    middle = slice(disparity.shape[1] // 4, 3 * disparity.shape[1] // 4)
    inner = np.isfinite(disparity)[:, middle]
    assert inner[seen_a[:, middle]].mean() > 0.7
    assert inner[[0, 1, -2, -1]].mean() > 0.9
    assert np.nanmax(np.abs(disparity[[0, 1, -2, -1]])) <= 0.25


def test_pixels_without_texture_have_no_disparity():
    rectification = om.rectify((SPHERE, SPHERE), POSES["sideways"], 1.0)
    image = noise_sphere()
    image[100:] = 128
    image += np.random.default_rng(0).integers(0, 3, image.shape, np.uint8)
    (a, seen_a), (b, seen_b) = (rectification.remap(image, which) for which in (0, 1))
    known = np.isfinite(match_rows(rectification, (a, b), (seen_a, seen_b)))
    bearings = rectification.camera.unproject(np.stack(np.meshgrid(*map(np.arange, known.shape[::-1])), -1))[0]
    down = (bearings @ rectification.rectified_from_a)[..., 1]
    assert known[down < -0.1].mean() > 0.7
    assert known[down > 0.1].mean() < 0.05


@pytest.fixture(scope="module")
def room():
    return scene_named("room")


@pytest.mark.parametrize(("kind", "limit", "share"), [("sphere", 0.025, 0.6), ("fisheye and mirror", 0.06, 0.2)])
def test_distances_of_a_rendered_pair(room, kind, limit, share):
    fisheye, mirror = fisheye_setup(400), mirror_setup(400)
    poses = fisheye.world_from_cam, fisheye.world_from_cam @ om.Pose(np.eye(3), np.array([0.25, 0.0, 0.0]))
    renderers = [Renderer(om.sphere(500), pose, room, samples=1) for pose in poses]
    if kind != "sphere":
        second = om.Pose(mirror.world_from_cam.rotation, poses[1].translation)
        renderers = [
            Renderer(fisheye.camera, poses[0], room, samples=1, theta=fisheye.theta),
            Renderer(mirror.camera, second, room, samples=1, theta=mirror.theta),
        ]
    left, right = renderers
    truth = left.truth().depth
    masks = tuple(np.isfinite(r.truth().depth) for r in renderers)
    pose = right.world_from_cam.inverse() @ left.world_from_cam
    rectification = om.rectify((left.camera, right.camera), pose, 0.75, masks)
    (a, seen_a), (b, seen_b) = (rectification.remap(r().image, k) for k, r in enumerate(renderers))
    dense = dense_stereo(rectification, (to_gray8(a), to_gray8(b)), (seen_a, seen_b), 0.3, 0.1)
    known = np.isfinite(dense.distance)
    assert dense.distance.shape == truth.shape
    assert not known[~masks[0]].any()
    assert known[masks[0]].mean() > share
    error = np.abs(dense.distance[known] / truth[known] - 1)
    assert np.median(error) < limit
    assert (dense.sigma[known] <= 0.1001 * dense.distance[known]).mean() > 0.99
    normalized = np.abs(dense.distance - truth)[known] / dense.sigma[known]
    assert 0.2 < 1.48 * np.median(normalized) < 1.5
