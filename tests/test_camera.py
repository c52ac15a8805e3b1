import dataclasses
import re

import cv2
import numpy as np
import pytest

import omnisight as om
from every_model import direction
from omnisight.camera import Camera
from omnisight.models import model_class, model_names
from omnisight.models.equidistant import Equidistant
from omnisight.models.pinhole import Pinhole

LENS = Camera(Equidistant(fx=281.0, fy=280.0, cx=319.5, cy=241.0), (640, 480))


def example(name):
    return Camera(model_class(name).example(), (1024, 768))


every_model = pytest.mark.parametrize("camera", [pytest.param(example(n), id=n) for n in model_names()])


@pytest.mark.parametrize("size", [(640,), (640, 480, 3), (-1, 480), (640, -480)])
def test_an_invalid_size_is_rejected(size):
    with pytest.raises(ValueError, match=re.escape(f"size must be (width, height), got {size}")):
        Camera(LENS.model, size)


def test_the_size_may_be_unknown():
    camera = Camera(LENS.model, (0, 0))
    assert (camera.width, camera.height) == (0, 0)
    assert not camera.in_image([0.0, 0.0])


@every_model
def test_cameras_with_equal_fields_are_equal(camera):
    count = len(camera.model.params)
    first, again, other = (
        dataclasses.replace(camera, covariance=value * np.eye(count), extra={"key": [1]}) for value in (1.0, 1.0, 2.0)
    )
    assert first == again
    assert hash(first) == hash(again)
    assert len({first, again, other, camera}) == 3
    assert first != dataclasses.replace(first, size=(1024, 769))
    assert first != camera.model


def test_a_camera_file_read_twice_gives_equal_cameras(tmp_path):
    camera = dataclasses.replace(LENS, covariance=np.eye(4), calibration={"rms": 0.2}, theta_max=1.2)
    om.save(camera, tmp_path / "camera.json")
    first, again = (om.load(tmp_path / "camera.json") for _ in range(2))
    assert first == again
    assert first.model == camera.model


@every_model
def test_a_camera_projects_like_its_model(camera):
    points = direction(np.array([0.1, 0.4]), 1.0)
    for ours, theirs in zip(camera.project(points), camera.model.project(points), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    pixels, _ = camera.project(points)
    np.testing.assert_allclose(camera.unproject(pixels)[0], points, atol=1e-12)
    np.testing.assert_allclose(camera.angle_of(pixels), [0.1, 0.4], atol=1e-12)


def test_the_image_extends_half_a_pixel_beyond_the_outer_pixel_centres():
    inside = [(-0.5, -0.5), (0, 0), (639, 479), (639.49, 479.49), (300.2, 200.7)]
    outside = [(-0.51, 0), (639.5, 0), (0, 479.5), (0, -0.51), (640, 480), (np.nan, 3), (np.inf, 3)]
    assert LENS.in_image(inside).all()
    assert not LENS.in_image(outside).any()
    assert LENS.in_image(np.zeros((2, 3, 2))).shape == (2, 3)


def test_the_angle_of_an_invalid_pixel_is_nan():
    angles = LENS.angle_of([[LENS.model.cx + 281.0, LENS.model.cy], [1e4, 0], [np.nan, 0]])
    np.testing.assert_allclose(angles, [1.0, np.nan, np.nan])


def test_the_border_follows_the_outermost_pixels():
    border = LENS.border(10)
    assert border.shape == (40, 2)
    assert LENS.in_image(border).all()
    np.testing.assert_allclose(border.min(0), 0)
    np.testing.assert_allclose(border.max(0), [639, 479])
    on_edge = np.isin(border[:, 0], [0, 639]) | np.isin(border[:, 1], [0, 479])
    assert on_edge.all()
    corner = np.hypot(319.5 / 281, 241 / 280)
    assert LENS.image_theta_max() == pytest.approx(corner)


def test_image_theta_max_of_an_image_larger_than_the_lens_is_that_of_the_model():
    camera = Camera(Equidistant(fx=50.0, fy=50.0, cx=2000.0, cy=2000.0), (4001, 4001))
    assert camera.image_theta_max() == camera.model.theta_max


def test_the_field_of_view_of_an_image_beside_the_axis_is_that_between_its_edges():
    whole = om.perspective((640, 480), 90)
    values = whole.model.to_dict()
    right = Camera(whole.model.with_values({"cx": values["cx"] - 400}), (240, 480))  # columns 400 to 639
    focal, left = values["fx"], 400 - 0.5 - values["cx"]
    expected = np.degrees(np.arctan2(left + 240, focal) - np.arctan2(left, focal))
    assert right.fov.horizontal == pytest.approx(expected)
    assert right.fov.vertical < whole.fov.vertical
    low, high = np.array([[left, 240.0, focal], [left + 240, -240.0, focal]])
    diagonal = np.degrees(np.arccos(low @ high / np.linalg.norm(low) / np.linalg.norm(high)))
    assert right.fov.diagonal == pytest.approx(diagonal)


# -- another size of the same image ---------------------------------------------------------------------------


@every_model
@pytest.mark.parametrize("factor", [0.5, 2.0, 0.37])
def test_pixel_centres_scale_about_the_corner_of_the_image(camera, factor):
    scaled = camera.scaled(factor)
    assert scaled.size == (round(1024 * factor), round(768 * factor))
    points = direction(np.linspace(0, 0.8, 9), np.linspace(-3, 3, 9))
    pixels, _ = camera.project(points)
    np.testing.assert_allclose(scaled.project(points)[0], (pixels + 0.5) * factor - 0.5, rtol=1e-12, atol=1e-9)


@every_model
def test_scaling_and_back_returns_the_camera(camera):
    again = camera.scaled(0.25).scaled(4.0)
    assert again.size == camera.size
    np.testing.assert_allclose(again.model.params, camera.model.params, rtol=1e-12)


def test_scaling_agrees_with_resizing_an_image():
    # A bright spot drawn where a point is seen is, in the image at half the size, where the scaled camera sees it.
    camera = Camera(Pinhole(fx=300.0, fy=300.0, cx=160.0, cy=119.5), (320, 240))
    point = np.array([0.21, -0.13, 1.0])
    at, _ = camera.project(point)
    v, u = np.mgrid[:240, :320]
    spot = np.exp(-((u - at[0]) ** 2 + (v - at[1]) ** 2) / (2 * 6.0**2))
    small = cv2.resize(spot, (160, 120), interpolation=cv2.INTER_AREA)
    v, u = np.mgrid[:120, :160]
    centroid = np.array([(u * small).sum(), (v * small).sum()]) / small.sum()
    np.testing.assert_allclose(centroid, camera.scaled(0.5).project(point)[0], atol=1e-3)


@every_model
def test_scaling_scales_the_projection_uncertainty(camera):
    count = len(camera.model.params)
    root = np.random.default_rng(0).normal(size=(count, count))
    small = dataclasses.replace(camera, covariance=root @ root.T)
    point = direction(np.array([0.3]), 1.0)
    derivatives = [c.model.project_with_jacobians(point)[3][0] for c in (small, small.scaled(2.5))]
    before, after = (d @ c.covariance @ d.T for d, c in zip(derivatives, (small, small.scaled(2.5)), strict=True))
    np.testing.assert_allclose(after, 2.5**2 * before, rtol=1e-9)


def test_scaling_keeps_the_rest():
    camera = Camera(LENS.model, LENS.size, theta_max=1.1, provenance={"file": "a.json"})
    scaled = camera.scaled(0.5)
    assert scaled.theta_max == 1.1
    assert scaled.provenance == {"file": "a.json"}


def test_scaling_scales_the_fields_in_px():
    focal, u, v, baseline = 300.0, 319.5, 239.5, 0.1
    p = [focal, 0.0, u, -focal * baseline, 0.0, focal, v, 0.0, 0.0, 0.0, 1.0, 0.0]
    extra = {
        "camera_name": "left",
        "projection_matrix": {"rows": 3, "cols": 4, "data": p},
        "roi": {"x_offset": 8, "y_offset": 0, "width": 100, "height": 100},
        "valid_radius_px": 200.0,
    }
    scaled = dataclasses.replace(LENS, extra=extra).scaled(0.5).extra
    point = np.array([0.3, -0.2, 2.0, 1.0])
    (before, after) = (np.reshape(f["projection_matrix"]["data"], (3, 4)) @ point for f in (extra, scaled))
    np.testing.assert_allclose(after[:2] / after[2], (before[:2] / before[2] + 0.5) * 0.5 - 0.5)
    assert {**scaled, "projection_matrix": None} == {
        "camera_name": "left",
        "projection_matrix": None,
        "valid_radius_px": 100.0,
    }


# -- samples ----------------------------------------------------------------------------------------------------


@every_model
def test_samples_are_bearings_and_pixels_in_the_image(camera):
    bearings, pixels = camera.samples()
    assert len(bearings) == len(pixels) > 50
    assert camera.in_image(pixels).all()
    np.testing.assert_allclose(np.linalg.norm(bearings, axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(camera.project(bearings)[0], pixels, atol=1e-6)


def test_samples_are_limited_to_the_given_or_calibrated_angle():
    whole = LENS.angle_of(LENS.samples()[1]).max()
    assert whole == pytest.approx(LENS.image_theta_max())
    calibrated = Camera(LENS.model, LENS.size, theta_max=0.9)
    assert 0.85 < calibrated.angle_of(calibrated.samples()[1]).max() <= 0.9
    assert 0.45 < calibrated.angle_of(calibrated.samples(0.5)[1]).max() <= 0.5
    assert len(LENS.samples(count=11)[0]) == 121


# -- field of view and camera matrix ------------------------------------------------------------------------------


@pytest.mark.parametrize("fov", [20, 90, 140])
def test_the_field_of_view_of_a_perspective_camera_is_that_it_was_made_for(fov):
    camera = om.perspective((640, 480), fov)
    half = np.tan(np.radians(fov / 2))
    vertical, diagonal = (2 * np.degrees(np.arctan(half * ratio)) for ratio in (480 / 640, 800 / 640))
    assert camera.fov == pytest.approx((fov, vertical, diagonal))
    assert camera.fov.horizontal == camera.fov[0]


def test_the_field_of_view_of_a_fisheye_and_a_sphere_exceeds_180_degrees():
    assert om.fisheye(500, 220).fov[:2] == pytest.approx((220, 220))
    assert om.sphere(512).fov[:2] == pytest.approx((360, 180))
    assert np.isnan(om.fisheye(500, 360).fov.diagonal)  # the corners are outside the image circle
    assert np.isnan(Camera(LENS.model, (0, 0)).fov).all()


@every_model
def test_the_camera_matrix_projects_points_near_the_axis(camera):
    points = np.array([[0.0, 0.0], [1e-4, 0.0], [0.0, -2e-4], [1e-4, 1e-4]])
    near = np.column_stack([points, np.ones(4)])
    expected = (near @ camera.K.T)[:, :2]
    np.testing.assert_allclose(camera.project(near)[0], expected, atol=2e-4)
    assert camera.K[2].tolist() == [0, 0, 1]
    assert camera.focal == pytest.approx(np.linalg.norm(camera.K[:2, :2], axis=0).mean())


def test_the_camera_matrix_of_a_pinhole_camera_is_its_own():
    camera = Camera(Pinhole(fx=300.0, fy=301.0, cx=160.0, cy=119.5), (320, 240))
    assert camera.K.tolist() == [[300, 0, 160], [0, 301, 119.5], [0, 0, 1]]
    assert camera.focal == 300.5
