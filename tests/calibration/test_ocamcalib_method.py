"""Scaramuzza's own way of calibrating: exact where its assumptions hold, and near the least on real corners."""

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
MIDDLE = (479.5, 359.5)
NOISE = 0.2

# Fields of view in degrees, and a polynomial that shows them on SIZE.
CAMERAS = {100: (330.0, -4e-4, 0.0, -6e-10), 190: (230.0, -1.6e-3, 4e-7, -2.6e-9), 250: (150.0, -3.6e-3, 6e-7, -2e-9)}


def camera(fov, centre=MIDDLE):
    return Ocam(*centre, 1.0, 0.0, 0.0, a=CAMERAS[fov])


def shoot(model, fov, count=7, noise=0.0, ring=False, seed=0):
    """Give views of tilted boards all over the cone (or far out only) with their poses."""
    rng = np.random.default_rng(seed)
    views, poses = [], []
    middle, half = BOARD.points.mean(0), np.radians(fov / 2)
    while len(views) < count:
        distance = rng.uniform(6, 11) if fov > 120 else rng.uniform(12, 20)
        theta = half - np.arctan(4.7 / distance) if ring else half * np.sqrt(rng.uniform(0, 0.9))
        phi = 2.4 * len(views) + rng.uniform(-0.3, 0.3)
        axis = np.array([-np.sin(phi), np.cos(phi), 0.0])  # the boards face the camera, but lean by up to 40 degrees
        turn = so3.exp(theta * axis) @ so3.exp([*rng.uniform(-0.5, 0.5, 2), 0.0]) @ so3.exp([0, 0, rng.uniform(-3, 3)])
        shift = so3.exp(theta * axis) @ (0, 0, distance) - turn @ middle
        points = BOARD.points @ turn.T + shift
        pixels, valid = model.project(points)
        angles = np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2])
        if valid.all() and angles.max() < half and (np.abs(pixels - MIDDLE) < (479, 359)).all():
            views.append((BOARD.points, pixels + rng.normal(0, noise, pixels.shape)))
            poses.append((turn, shift))
    return observe(views), poses


# -- the steps, one by one ---------------------------------------------------------------------------------------


def test_the_third_row_makes_two_columns_orthonormal():
    for vector in np.random.default_rng(0).normal(size=(50, 3)) * 2:
        r = so3.exp(vector)
        r31, r32 = third_row(r[0, 0], r[1, 0], r[0, 1], r[1, 1])
        sign = np.sign(r31 * r[2, 0]) or 1.0
        np.testing.assert_allclose(np.array([r31, r32]) * sign, r[2, :2], atol=1e-7)


@pytest.mark.parametrize("fov", CAMERAS)
def test_one_equation_gives_the_poses_but_for_depth_and_a_sign(fov):
    truth = camera(fov)
    views, poses = shoot(truth, fov)
    columns = extrinsics_up_to_scale(views, views.pixels - MIDDLE)
    for found, (turn, shift) in zip(columns, poses, strict=True):
        np.testing.assert_allclose(found[:2], np.stack([turn[:2, 0], turn[:2, 1], shift[:2]], -1), atol=1e-6)
        np.testing.assert_allclose(found[2, :2] * np.sign(found[2, 0] * turn[2, 0]), turn[2, :2], atol=1e-6)


@pytest.mark.parametrize("ring", [False, True])
@pytest.mark.parametrize("fov", [190, 250])
def test_two_equations_give_polynomial_depths_and_sign_also_past_90_degrees(fov, ring):
    truth = camera(fov)
    views, poses = shoot(truth, fov, ring=ring)
    plane = views.pixels - MIDDLE
    columns = extrinsics_up_to_scale(views, plane)
    a, depths, signs = polynomial_and_depths(views, plane, columns, 4)
    radius = np.linspace(*np.quantile(np.hypot(*plane.T), [0.05, 1]), 20)
    found, true = (np.polynomial.polynomial.polyval(radius, np.insert(f, 1, 0.0)) for f in (a, truth.a))
    np.testing.assert_allclose(found, true, atol=1e-5 * abs(truth.a[0]))
    np.testing.assert_allclose(depths, [shift[2] for _, shift in poses], atol=1e-5)
    np.testing.assert_allclose(signs * columns[:, 2, 0], [turn[2, 0] for turn, _ in poses], atol=1e-6)
    past = np.concatenate([(BOARD.points @ turn.T + shift)[:, 2] < 0 for turn, shift in poses])
    assert past.any()


@pytest.mark.parametrize("fov", CAMERAS)
def test_exact_corners_about_the_true_centre_are_explained_exactly_by_the_linear_steps(fov):
    views, poses = shoot(camera(fov), fov)
    state = linear_steps(views, np.array(MIDDLE), 4)
    assert ReprojectionError.of(state, views).rms < 1e-5
    np.testing.assert_allclose(state.rotations, [turn for turn, _ in poses], atol=1e-6)


@pytest.mark.parametrize(("fov", "shift"), [(100, (12.0, -7.0)), (190, (-55.0, 30.0)), (250, (18.0, 25.0))])
def test_the_search_finds_the_centre(fov, shift):
    centre = np.array(MIDDLE) + shift
    views, _ = shoot(camera(fov, tuple(centre)), fov)
    found = search_centre(None, views, SIZE, 4, lambda *_: None)
    assert np.hypot(found.model.cx - centre[0], found.model.cy - centre[1]) < 0.3
    assert ReprojectionError.of(found, views).rms < 0.1


# -- the whole ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fov", [190, 250])
def test_every_step_lowers_the_error_to_the_noise(fov):
    views, _ = shoot(camera(fov, (470.0, 366.0)), fov, noise=NOISE)
    told = []
    found = calibrate_ocamcalib(views, SIZE, progress=lambda *state: told.append(state))
    assert found.linear.rms > found.centred.rms > found.refined.rms
    assert found.refined.rms == pytest.approx(NOISE * np.sqrt(2), rel=0.12)
    assert found.refined.mean < found.refined.rms
    assert found.refined == ReprojectionError.of(found.state, views)
    # By turns never ends below both at once, and here not far above.
    least = refine(found.state, views, free_parameters=FreeParameters.of(found.model), loss="squared").state
    assert -1e-6 < found.refined.rms - ReprojectionError.of(least, views).rms < 0.01
    assert list(dict.fromkeys(stage for stage, _, _ in told)) == ["search centre", "refine by turns"]
    assert all(0 <= done <= total for _, done, total in told)


def test_a_known_centre_is_not_searched_for():
    centre = (470.0, 366.0)
    views, _ = shoot(camera(190, centre), 190, noise=NOISE)
    told = []
    found = calibrate_ocamcalib(views, SIZE, centre=centre, progress=lambda stage, *_: told.append(stage))
    assert found.linear == found.centred
    assert set(told) == {"refine by turns"}


def test_parts_of_boards_and_mirrored_pictures_do_as_well():
    views, _ = shoot(camera(250), 250, noise=NOISE)
    rng = np.random.default_rng(1)
    parts = []
    for rows in views.groups:
        seen = np.sort(rng.choice(BOARD.size, rng.integers(20, BOARD.size), replace=False))
        parts.append((views.points[rows][seen], views.pixels[rows][seen] * (-1, 1) + (SIZE[0] - 1, 0)))
    found = calibrate_ocamcalib(observe(parts), SIZE)
    assert found.refined.rms < 1.1 * NOISE * np.sqrt(2)
    assert np.linalg.det(found.state.rotations) == pytest.approx(np.ones(len(parts)))


@pytest.mark.parametrize("degree", [2, 6])
def test_other_degrees(degree):
    views, _ = shoot(camera(190), 190, count=5, noise=NOISE)
    found = calibrate_ocamcalib(views, SIZE, degree=degree)
    assert len(found.model.a) == degree
    # A parabola does not describe this lens.
    assert (found.refined.rms < 1.1 * NOISE * np.sqrt(2)) == (degree > 2)


def test_what_cannot_be_calibrated_says_so():
    views, _ = shoot(camera(190), 190, count=3)
    short = observe([(BOARD.points[:5], views.pixels[:5])], ["a.png"])
    with pytest.raises(ValueError, match=r"a\.png: 5 corners, the linear steps need 6"):
        calibrate_ocamcalib(short, SIZE)
    with pytest.raises(ValueError, match="degree 2 or more, got 1"):
        calibrate_ocamcalib(views, SIZE, degree=1)
    with pytest.raises(ValueError, match="no image"):
        calibrate_ocamcalib(observe([]), SIZE)


def test_corners_that_mean_nothing_are_no_good_calibration():
    rng = np.random.default_rng(0)
    noise = observe([(BOARD.points, rng.uniform(0, 700, (BOARD.size, 2))) for _ in range(4)])
    assert calibrate_ocamcalib(noise, SIZE).refined.rms > 20


# -- real corners ------------------------------------------------------------------------------------------------

# Images' size, how far from the axis corners reach (degrees), and which views: these of the lens have their best
# centre between two places of the grid, and a bad one far away is better than either.
REAL = {"kaidan": ((640, 480), 115, slice(None)), "fstereo_right": ((960, 600), 60, slice(None, None, 2))}


@pytest.mark.slow
@pytest.mark.parametrize("name", REAL)
def test_real_corners_are_explained_almost_as_well_as_by_moving_all_at_once(data, name):
    size, reach, some = REAL[name]
    with np.load(data("corners") / f"{name}.npz") as stored:
        board = Checkerboard(*(int(n) for n in stored["pattern"]))
        views = observe([(board.points, pixels) for pixels in stored["corners"][some].astype(float)])
    found = calibrate_ocamcalib(views, size)
    assert found.linear.rms > found.centred.rms > found.refined.rms
    least = ReprojectionError.of(refine(found.state, views, loss="squared").state, views)
    assert least.rms <= found.refined.rms < 1.1 * least.rms
    points, _ = found.state.points(views)
    assert np.degrees(np.arccos(points[:, 2] / np.linalg.norm(points, axis=1))).max() > reach
    assert found.refined.rms < 0.4
