"""Scaramuzza's original method: exact where its assumptions hold, and close to the optimum on real corners."""

import numpy as np
import pytest

from calibrating import observe
from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.ocamcalib import (
    ReprojectionError,
    calibrate_ocamcalib,
    extrinsics_up_to_scale,
    linear_steps,
    polynomial_and_depths,
    search_centre,
    third_row,
)
from omnisight.geometry import rotation as so3
from omnisight.models.ocam import Ocam
from omnisight.targets import Checkerboard

BOARD = Checkerboard(9, 6)
SIZE = (960, 720)
CENTRE = (479.5, 359.5)
NOISE = 0.2

# Polynomial of a camera by its field of view (degrees).
CAMERAS = {100: (330.0, -4e-4, 0.0, -6e-10), 190: (230.0, -1.6e-3, 4e-7, -2.6e-9), 250: (150.0, -3.6e-3, 6e-7, -2e-9)}


def camera(fov, centre=CENTRE):
    return Ocam(*centre, 1.0, 0.0, 0.0, a=CAMERAS[fov])


def observe_boards(model, fov, count=7, noise=0.0, ring=False, seed=0):
    """Return observations of tilted boards over the field of view (or near its border only), and their poses."""
    rng = np.random.default_rng(seed)
    views, poses = [], []
    middle, half = BOARD.points.mean(0), np.radians(fov / 2)
    while len(views) < count:
        distance = rng.uniform(6, 11) if fov > 120 else rng.uniform(12, 20)
        theta = half - np.arctan(4.7 / distance) if ring else half * np.sqrt(rng.uniform(0, 0.9))
        phi = 2.4 * len(views) + rng.uniform(-0.3, 0.3)
        axis = np.array([-np.sin(phi), np.cos(phi), 0.0])  # the boards face the camera, tilted by up to 40 degrees
        rotation = (
            so3.exp(theta * axis) @ so3.exp([*rng.uniform(-0.5, 0.5, 2), 0.0]) @ so3.exp([0, 0, rng.uniform(-3, 3)])
        )
        translation = so3.exp(theta * axis) @ (0, 0, distance) - rotation @ middle
        points = BOARD.points @ rotation.T + translation
        pixels, valid = model.project(points)
        angles = np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2])
        if valid.all() and angles.max() < half and (np.abs(pixels - CENTRE) < (479, 359)).all():
            views.append((BOARD.points, pixels + rng.normal(0, noise, pixels.shape)))
            poses.append((rotation, translation))
    return observe(views, SIZE), poses


def test_third_row_makes_two_columns_orthonormal():
    for vector in np.random.default_rng(0).normal(size=(50, 3)) * 2:
        r = so3.exp(vector)
        r31, r32 = third_row(r[0, 0], r[1, 0], r[0, 1], r[1, 1])
        sign = np.sign(r31 * r[2, 0]) or 1.0
        np.testing.assert_allclose(np.array([r31, r32]) * sign, r[2, :2], atol=1e-7)


@pytest.mark.parametrize("fov", CAMERAS)
def test_extrinsics_are_determined_up_to_depth_and_a_sign(fov):
    truth = camera(fov)
    views, poses = observe_boards(truth, fov)
    columns = extrinsics_up_to_scale(views, views.pixels - CENTRE)
    for result, (rotation, translation) in zip(columns, poses, strict=True):
        np.testing.assert_allclose(
            result[:2], np.stack([rotation[:2, 0], rotation[:2, 1], translation[:2]], -1), atol=1e-6
        )
        np.testing.assert_allclose(result[2, :2] * np.sign(result[2, 0] * rotation[2, 0]), rotation[2, :2], atol=1e-6)


@pytest.mark.parametrize("ring", [False, True])
@pytest.mark.parametrize("fov", [190, 250])
def test_polynomial_depths_and_signs_are_determined_beyond_90_degrees(fov, ring):
    truth = camera(fov)
    views, poses = observe_boards(truth, fov, ring=ring)
    plane = views.pixels - CENTRE
    columns = extrinsics_up_to_scale(views, plane)
    a, depths, signs = polynomial_and_depths(views, plane, columns, 4)
    radius = np.linspace(*np.quantile(np.hypot(*plane.T), [0.05, 1]), 20)
    result, true = (np.polynomial.polynomial.polyval(radius, np.insert(f, 1, 0.0)) for f in (a, truth.a))
    np.testing.assert_allclose(result, true, atol=1e-5 * abs(truth.a[0]))
    np.testing.assert_allclose(depths, [translation[2] for _, translation in poses], atol=1e-5)
    np.testing.assert_allclose(signs * columns[:, 2, 0], [rotation[2, 0] for rotation, _ in poses], atol=1e-6)
    is_beyond = np.concatenate([(BOARD.points @ rotation.T + translation)[:, 2] < 0 for rotation, translation in poses])
    assert is_beyond.any()


@pytest.mark.parametrize("fov", CAMERAS)
def test_linear_steps_are_exact_about_the_true_centre(fov):
    views, poses = observe_boards(camera(fov), fov)
    state = linear_steps(views, np.array(CENTRE), 4)
    assert ReprojectionError.of(state, views).rms < 1e-5
    np.testing.assert_allclose(state.rotations, [rotation for rotation, _ in poses], atol=1e-6)


@pytest.mark.parametrize(("fov", "translation"), [(100, (12.0, -7.0)), (190, (-55.0, 30.0)), (250, (18.0, 25.0))])
def test_centre_search_finds_the_centre(fov, translation):
    centre = np.array(CENTRE) + translation
    views, _ = observe_boards(camera(fov, tuple(centre)), fov)
    result = search_centre(None, views, SIZE, 4, lambda *_: None)
    assert np.hypot(result.model.cx - centre[0], result.model.cy - centre[1]) < 0.3
    assert ReprojectionError.of(result, views).rms < 0.1


@pytest.mark.parametrize("fov", [190, 250])
def test_each_step_reduces_the_error_down_to_the_noise(fov):
    views, _ = observe_boards(camera(fov, (470.0, 366.0)), fov, noise=NOISE)
    calls = []
    result = calibrate_ocamcalib(views, SIZE, progress=lambda *call: calls.append(call))
    assert result.linear.rms > result.centred.rms > result.refined.rms
    assert result.refined.rms == pytest.approx(NOISE * np.sqrt(2), rel=0.12)
    assert result.refined.mean < result.refined.rms
    assert result.refined == ReprojectionError.of(result.state, views)
    # The alternation ends slightly above the joint minimum.
    least = refine(result.state, views, free_parameters=FreeParameters.of(result.model), loss="squared").state
    assert -1e-6 < result.refined.rms - ReprojectionError.of(least, views).rms < 0.01
    assert list(dict.fromkeys(stage for stage, _, _ in calls)) == ["search centre", "refine"]
    assert all(0 <= done <= total for _, done, total in calls)


def test_known_centre_is_not_searched():
    centre = (470.0, 366.0)
    views, _ = observe_boards(camera(190, centre), 190, noise=NOISE)
    calls = []
    result = calibrate_ocamcalib(views, SIZE, centre=centre, progress=lambda stage, *_: calls.append(stage))
    assert result.linear == result.centred
    assert set(calls) == {"refine"}


def test_partial_boards_and_mirrored_images_are_calibrated():
    views, _ = observe_boards(camera(250), 250, noise=NOISE)
    rng = np.random.default_rng(1)
    parts = []
    for rows in views.groups:
        visible = np.sort(rng.choice(BOARD.size, rng.integers(20, BOARD.size), replace=False))
        parts.append((views.points[rows][visible], views.pixels[rows][visible] * (-1, 1) + (SIZE[0] - 1, 0)))
    result = calibrate_ocamcalib(observe(parts, SIZE), SIZE)
    assert result.refined.rms < 1.1 * NOISE * np.sqrt(2)
    assert np.linalg.det(result.state.rotations) == pytest.approx(np.ones(len(parts)))


@pytest.mark.parametrize("degree", [2, 6])
def test_degree_of_the_polynomial_may_be_chosen(degree):
    views, _ = observe_boards(camera(190), 190, count=5, noise=NOISE)
    result = calibrate_ocamcalib(views, SIZE, degree=degree)
    assert len(result.model.a) == degree
    # A parabola does not describe this lens.
    assert (result.refined.rms < 1.1 * NOISE * np.sqrt(2)) == (degree > 2)


def test_insufficient_input_is_an_error():
    views, _ = observe_boards(camera(190), 190, count=3)
    short = observe([(BOARD.points[5:10], views.pixels[5:10])], SIZE, names=["a.png"])
    with pytest.raises(ValueError, match=r"a\.png: 5 corners, but the linear steps need 6"):
        calibrate_ocamcalib(short, SIZE)
    with pytest.raises(ValueError, match="degree 2 or more, got 1"):
        calibrate_ocamcalib(views, SIZE, degree=1)
    with pytest.raises(ValueError, match="no image with a board"):
        calibrate_ocamcalib(observe([], SIZE), SIZE)


def test_random_corners_have_a_large_rms():
    rng = np.random.default_rng(0)
    noise = observe([(BOARD.points, rng.uniform(0, 700, (BOARD.size, 2))) for _ in range(4)], SIZE)
    assert calibrate_ocamcalib(noise, SIZE).refined.rms > 20


# Image size, largest off-axis angle of the corners (degrees), and the views: with those of fstereo_right, the best
# centre is between two points of the grid, and a wrong one far away has a lower error than either.
REAL = {"kaidan": ((640, 480), 115, slice(None)), "fstereo_right": ((960, 600), 60, slice(None, None, 2))}


@pytest.mark.slow
@pytest.mark.parametrize("name", REAL)
def test_rms_on_real_corners_is_close_to_that_of_the_joint_minimum(data, name):
    size, theta_max, selected = REAL[name]
    with np.load(data("corners") / f"{name}.npz") as stored:
        board = Checkerboard(*(int(n) for n in stored["pattern"]))
        views = observe([(board.points, pixels) for pixels in stored["corners"][selected].astype(float)], size)
    result = calibrate_ocamcalib(views, size)
    assert result.linear.rms > result.centred.rms > result.refined.rms
    joint = ReprojectionError.of(refine(result.state, views, loss="squared").state, views)
    assert joint.rms <= result.refined.rms < 1.1 * joint.rms
    points, _ = result.state.points(views)
    assert np.degrees(np.arccos(points[:, 2] / np.linalg.norm(points, axis=1))).max() > theta_max
    assert result.refined.rms < 0.4
