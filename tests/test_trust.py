"""How far a calibration can be trusted: what it says of itself is so, and what is wrong with it is said."""

import dataclasses

import numpy as np
import pytest

from omnisight.calibrate import BoardViews, calibrate_camera
from omnisight.calibrate.candidates import Candidate
from omnisight.calibrate.freedom import Freedom
from omnisight.calibrate.initialise import posed
from omnisight.calibrate.trust.compare import turned_difference
from omnisight.calibrate.trust.covariance import camera_covariance
from omnisight.calibrate.trust.coverage import Coverage
from omnisight.calibrate.trust.halves import compare_halves
from omnisight.calibrate.trust.uncertainty import Uncertainty, UncertaintyMap
from omnisight.camera import Camera
from omnisight.geometry import rotation as so3
from omnisight.geometry.sphere import angle_from_axis, cap, polar
from omnisight.models import model_class
from test_calibrate import BOARD, NOISE, SIZE, calibrated, lens, shoot

SIMULATED = 200


def noisy(exact, seed, noise=NOISE):
    rng = np.random.default_rng(seed)
    return BoardViews.of([(x, p + rng.normal(0, noise, p.shape)) for x, p in exact])


def one(model, truth, views, **freedom):
    """Calibrate one model from the truth, and give its candidate and its camera with covariance."""
    start = posed(truth, views)
    best = Candidate.fit(model, start, views, Freedom.of(start.model, **freedom), loss="huber")
    reach = angle_from_axis(best.state.points(views)[0]).max()
    covariance = camera_covariance(best, views)
    return best, Camera(best.state.model, SIZE, theta_max=float(reach), covariance=covariance)


# -- how sure ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("fov", "warp"), [(180, False), (280, True)])
def test_simulated_calibrations_scatter_as_each_of_them_predicts(fov, warp):
    truth = lens(fov)
    exact = shoot(truth, fov, np.random.default_rng(0), count=10, noise=0.0)
    bearings = cap(np.radians(fov / 2) * 0.95, 6)
    pixels, _ = truth.project(bearings)
    true = {True: [], False: []}
    said = {True: [], False: []}
    angles, turned = [], []
    for seed in range(SIMULATED):
        _, camera = one(truth.name, truth, noisy(exact, seed), warp=warp)
        uncertainty = Uncertainty.of(camera)
        for free in (True, False):
            said[free].append(np.trace(uncertainty.projection(bearings, turned=free), axis1=1, axis2=2))
        true[True].append((turned_difference(camera.model, bearings, pixels) ** 2).sum(1))
        true[False].append(((camera.project(bearings)[0] - pixels) ** 2).sum(1))
        angles.append(uncertainty.bearing(bearings, turned=False) ** 2)
        turned.append(np.arccos(np.clip((camera.unproject(pixels)[0] * bearings).sum(1), -1, 1)) ** 2)
    for free in (True, False):
        ratio = np.sqrt(np.mean(said[free], 0) / np.mean(true[free], 0))
        assert ((ratio > 0.85) & (ratio < 1.15)).all(), (free, ratio.min(), ratio.max())
    ratio = np.sqrt(np.mean(angles, 0) / np.mean(turned, 0))
    assert ((ratio > 0.85) & (ratio < 1.15)).all(), ("bearing", ratio.min(), ratio.max())


def test_a_bearing_is_as_sure_as_its_pixel_over_the_focal_length():
    model = model_class("equidistant")(300.0, 300.0, 480.0, 480.0)
    covariance = np.diag([0.0, 0.0, 0.25, 0.0])  # the centre, half a pixel to the side
    uncertainty = Uncertainty.of(Camera(model, SIZE, theta_max=1.2, covariance=covariance))
    bearings = polar(np.array([0.0, 0.4, 1.1]), np.zeros(3))
    np.testing.assert_allclose(np.sqrt(uncertainty.projection(bearings, turned=False)[:, 0, 0]), 0.5)
    np.testing.assert_allclose(uncertainty.bearing(bearings, turned=False), 0.5 / 300)
    # A centre beside its place is a turn of the camera, and on the axis nothing else.
    turned = np.sqrt(np.trace(uncertainty.projection(bearings), axis1=1, axis2=2))
    assert (turned < 0.25).all()


def test_more_noise_and_fewer_pictures_are_less_sure():
    truth = lens(180)
    exact = shoot(truth, 180, np.random.default_rng(0), count=16, noise=0.0)

    def worst(views):
        return UncertaintyMap.of(one("equisolid", truth, views)[1]).worst()[0]

    usual = worst(noisy(exact, 0))
    assert worst(noisy(exact, 0, 2 * NOISE)) == pytest.approx(2 * usual, rel=0.1)
    assert worst(noisy(exact[::4], 0)) > 1.5 * usual


def test_beyond_the_corners_the_map_says_so_and_is_less_sure():
    truth = lens(200)
    views = noisy(shoot(truth, 120, np.random.default_rng(0), count=12, noise=0.0), 0)
    _, camera = one("kannala_brandt", truth, views)
    found = UncertaintyMap.of(camera)
    assert found.calibrated.any()
    assert not found.calibrated.all()
    assert found.theta[found.calibrated].max() == pytest.approx(camera.theta_max)
    last = found.shown.any(1).nonzero()[0][-1]
    assert np.nanmean(found.pixels[last]) > 5 * np.nanmax(found.pixels[found.calibrated])


def test_a_camera_without_covariance_says_what_to_do():
    with pytest.raises(ValueError, match="no covariance: calibrate it with omnisight"):
        Uncertainty.of(Camera(lens(180), SIZE))


# -- halves ------------------------------------------------------------------------------------------------------


def test_halves_differ_as_predicted_where_there_is_only_noise():
    truth = lens(180)
    exact = shoot(truth, 180, np.random.default_rng(0), count=12, noise=0.0)
    ratios = []
    for seed in range(12):
        views = noisy(exact, seed)
        best, camera = one("equisolid", truth, views)
        found = compare_halves(best, camera, views, loss="huber")
        assert found is not None
        ratios.append(found.ratio)
    assert 0.6 < np.mean(ratios) < 1.3


def test_halves_betray_a_model_that_is_too_poor_and_the_covariance_makes_up_for_it():
    truth = lens(200)
    views = noisy(shoot(truth, 200, np.random.default_rng(0), count=16, noise=0.0), 0, 0.05)
    found = calibrate_camera(views, SIZE, model="stereographic", flat=True)
    halves = found.trust.halves
    assert halves is not None
    assert halves.ratio > 3
    assert any("Two halves of the pictures give cameras" in reason for reason in found.verdict.reasons)
    assert any("the model is too poor for this lens: try --model spline" in r for r in found.verdict.reasons)
    covariance = camera_covariance(found.candidates[0], views)
    np.testing.assert_allclose(found.camera.covariance, covariance * halves.ratio**2)


def test_few_pictures_have_no_halves():
    _, found = calibrated(180, 0, 7, model="equisolid")
    assert found.trust.halves is None


# -- what the model leaves ---------------------------------------------------------------------------------------


def test_the_spline_shows_what_a_poor_model_leaves_and_where():
    truth = lens(200)
    views = noisy(shoot(truth, 200, np.random.default_rng(0), count=16, noise=0.0), 0, 0.05)
    poor = calibrate_camera(views, SIZE, model="equidistant", flat=True)
    fine = calibrate_camera(views, SIZE, model="kannala_brandt", flat=True)
    left, none = poor.trust.ceiling, fine.trust.ceiling
    assert left is not None
    assert none is not None
    assert left.left > 0.8 * poor.held_out_rms
    assert f"the model leaves {left.left:.3f} px" in str(left)
    assert none.left < 0.3 * fine.held_out_rms
    assert left.spline_rms.max() < 0.2
    held_out = poor.candidates[0].held_out_lengths[~poor.outliers]
    angles = angle_from_axis(poor.state.points(views)[0])[~poor.outliers]
    ring = (angles >= left.edges[left.where]) & (angles <= left.edges[left.where + 1])
    assert np.sqrt((held_out[ring] ** 2).mean()) == pytest.approx(left.model_rms[left.where], rel=0.05)


# -- a board that is not flat ------------------------------------------------------------------------------------


def bent(exact_warp, seed=0, noise=0.1, fov=180, count=12):
    """See boards whose middle stands off the plane of their edges."""
    truth = lens(fov)
    flat = BoardViews.of(shoot(truth, fov, np.random.default_rng(seed), count=count, noise=0.0))
    state = dataclasses.replace(posed(truth, flat), warp=np.array(exact_warp, float))
    pixels, _ = truth.project(state.points(flat)[0])
    rng = np.random.default_rng(seed)
    return BoardViews.of([(flat.points[g], pixels[g] + rng.normal(0, noise, pixels[g].shape)) for g in flat.groups])


def test_a_bent_board_is_found_bent_and_the_camera_is_better_for_it():
    views = bent((0.08, -0.05))
    found = calibrate_camera(views, SIZE, model="equisolid")
    np.testing.assert_allclose(found.state.warp, (0.08, -0.05), atol=0.012)
    np.testing.assert_allclose(found.camera.calibration["board_warp"], found.state.warp)
    assert found.rms == pytest.approx(0.1 * np.sqrt(2), rel=0.1)
    flat = calibrate_camera(views, SIZE, model="equisolid", flat=True)
    assert not flat.state.warp.any()
    assert flat.held_out_rms > 1.2 * found.held_out_rms

    def error(calibration):
        bearings = cap(1.4, 8)
        off = turned_difference(calibration.camera.model, bearings, lens(180).project(bearings)[0])
        return np.sqrt((off**2).sum(1).mean())

    assert error(found) < 0.7 * error(flat)


def test_a_flat_board_is_left_flat():
    for seed in range(3):
        found = calibrate_camera(bent((0.0, 0.0), seed), SIZE, model="equisolid")
        assert not found.state.warp.any()
        assert "board_warp" not in found.camera.calibration


# -- square pixels -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", ["equisolid", "mei", "kannala_brandt", "ocam"])
def test_square_pixels_have_one_focal_length(model):
    _, found = calibrated(180, 0, model=model, square=True)
    values = found.camera.model.to_dict()
    if model == "ocam":
        assert (values["c"], values["d"], values["e"]) == (1.0, 0.0, 0.0)
    else:
        assert values["fx"] == values["fy"]
        rows = found.camera.covariance[:2]
        np.testing.assert_allclose(rows[0], rows[1])
    assert found.rms < 1.1 * NOISE * np.sqrt(2)
    free = calibrated(180, 0, model=model)[1].candidates[0]
    assert found.candidates[0].parameters == free.parameters - (2 if model == "ocam" else 1)


# -- the verdict -------------------------------------------------------------------------------------------------


def test_a_good_set_is_called_good():
    _, found = calibrated(180, 0, 16, noise=0.1)
    assert str(found.verdict) == "good"
    assert found.verdict.reasons == ()
    assert found.camera.calibration["verdict"] == "good"


def test_corners_on_one_side_only_are_called_so_and_the_side_is_named():
    truth = lens(180)
    seen = [
        (x, p) for x, p in shoot(truth, 180, np.random.default_rng(0), count=40) if p[:, 0].min() > SIZE[0] / 2 + 20
    ]
    assert len(seen) >= 6
    found = calibrate_camera(BoardViews.of(seen), SIZE, model="equisolid")
    assert str(found.verdict) == "usable"
    (said,) = [reason for reason in found.verdict.reasons if "around the axis empty" in reason]
    assert "put the board" in said
    assert "left" in said
    assert "right" not in said.replace("upper right", "").replace("lower right", "")


def test_corners_in_the_middle_only_name_the_rim():
    truth = lens(180)
    views = BoardViews.of(shoot(truth, 90, np.random.default_rng(0), count=16))
    found = calibrate_camera(views, SIZE, model="equisolid")
    (said,) = [reason for reason in found.verdict.reasons if "of what the picture shows" in reason]
    assert "degrees from the axis all around" in said


def test_coverage_counts_what_is_shown():
    _, found = calibrated(180, 0, 16)
    coverage = Coverage.of(found.camera, found.state, found.views)
    assert coverage.corners[1:].sum() + coverage.corners[0, 0] == 16 * BOARD.size
    assert coverage.share > 0.6
    assert coverage.gap == 0.0
    right = found.views.subset([i for i, g in enumerate(found.views.groups) if found.views.pixels[g, 0].min() > 500])
    state = posed(found.camera.model, right)
    aside = Coverage.of(found.camera, state, right)
    assert aside.gap >= np.pi / 2
    assert aside.share < coverage.share


def test_pictures_that_tilt_a_little_are_usable_and_the_tilt_is_told():
    truth = lens(60)
    middle = BOARD.points.mean(0)
    rng = np.random.default_rng(0)
    views = []
    for i, (x, y, distance) in enumerate(((0, 0, 14), (3, 1, 16), (-3, 2, 18), (1, -3, 15), (-2, -2, 17), (2, 2, 13))):
        lean = so3.exp([np.radians(7.0) * (-1) ** i, 0.0, x / 3])
        pixels, _ = truth.project((BOARD.points - middle) @ lean.T + [x, y, distance])
        views.append((BOARD.points, pixels + rng.normal(0, 0.05, pixels.shape)))
    found = calibrate_camera(BoardViews.of(views), SIZE, model="radial_tangential")
    (tilt,) = [check for check in found.verdict.checks if check.name == "tilt"]
    assert str(tilt.level) == "usable"
    assert "tilt only 14 degrees" in tilt.sentence or "tilt only 15 degrees" in tilt.sentence


@pytest.mark.parametrize("model", ["kannala_brandt", "unified"])
def test_three_copies_of_a_picture_are_not_used(model):
    view = shoot(lens(180), 180, np.random.default_rng(0))[3]
    found = calibrate_camera(BoardViews.of([view] * 3), SIZE, model=model, force=True)
    assert str(found.verdict) == "do not use"
    assert "1 picture leaves" in found.verdict.reasons[0]
    assert "or a model with fewer parameters" in found.verdict.reasons[0]


def test_a_model_forced_on_a_lens_it_does_not_describe_is_not_called_good():
    views = noisy(shoot(lens(200), 200, np.random.default_rng(0), count=16, noise=0.0), 0, 0.05)
    found = calibrate_camera(views, SIZE, model="equidistant", flat=True)
    assert str(found.verdict) != "good"
    (said,) = [reason for reason in found.verdict.reasons if "that a spline explains" in reason]
    assert "--model auto" in said


def test_pictures_of_another_camera_are_named():
    own = shoot(lens(180), 180, np.random.default_rng(0), count=10)
    other = shoot(lens(100), 100, np.random.default_rng(1), count=2)
    names = [f"{i}.png" for i in range(10)] + ["a.png", "b.png"]
    found = calibrate_camera(BoardViews.of([*own, *other], names), SIZE)
    (said,) = [reason for reason in found.verdict.reasons if "no common camera" in reason]
    assert "a.png" in said
    assert "b.png" in said
    assert "0.png" not in said
    assert "--drop" in said


def test_parallel_boards_that_lean_from_the_axis_of_a_wide_lens_are_usable():
    truth = lens(180)
    middle = BOARD.points.mean(0)
    rng = np.random.default_rng(0)
    turn = so3.exp([0.7, 0.2, 0.0])
    views = []
    for i in range(15):
        theta, phi = 1.1 * np.sqrt((i + 0.5) / 15), 2.4 * i
        away = rng.uniform(8, 12) * polar(np.array(theta), np.array(phi))
        pixels, valid = truth.project((BOARD.points - middle) @ turn.T + away)
        assert valid.all()
        views.append((BOARD.points, pixels + rng.normal(0, 0.05, pixels.shape)))
    found = calibrate_camera(BoardViews.of(views), SIZE, model="equisolid")
    (tilt,) = [check for check in found.verdict.checks if check.name == "tilt"]
    assert str(tilt.level) == "usable"
    assert "leaves the focal length open" not in tilt.sentence


def test_what_is_not_shown_is_no_gap():
    _, found = calibrated(180, 0, 16)
    coverage = Coverage.of(found.camera, found.state, found.views)
    corners, shown = coverage.corners.copy(), coverage.shown.copy()
    corners[:, 3:6] = 0
    assert dataclasses.replace(coverage, corners=corners).gap > np.pi / 2
    shown[:, 3:6] = False
    assert dataclasses.replace(coverage, corners=corners, shown=shown).gap == 0.0
