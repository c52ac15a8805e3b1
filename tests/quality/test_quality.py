"""How far a calibration can be trusted: what it says of itself is so, and what is wrong with it is said."""

import dataclasses

import numpy as np
import pytest

from calibrating import calibrate, observe
from lenses import NOISE, SIZE, calibrate_lens, lens, observe_boards
from omnisight.calibration.candidate import Candidate
from omnisight.calibration.covariance import camera_covariance, noise_covariance, view_scatter
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.resection import resect
from omnisight.camera import Camera
from omnisight.geometry.sphere import angle_from_axis, cap, polar
from omnisight.models import model_class
from omnisight.quality.split_half import rotation_aligned_difference, run_split_half_test
from omnisight.quality.uncertainty import Uncertainty, UncertaintyMap

SIMULATED = 200


def noisy(exact, seed, noise=NOISE):
    rng = np.random.default_rng(seed)
    return observe([(x, p + rng.normal(0, noise, p.shape)) for x, p in exact])


def one(model, truth, views, **free_parameters):
    """Calibrate one model from the truth, and give its candidate and its camera with covariance."""
    start = resect(truth, views)
    best = Candidate.fit(model, start, views, FreeParameters.of(start.model, **free_parameters), loss="huber")
    reach = angle_from_axis(best.state.points(views)[0]).max()
    covariance = camera_covariance(best, views)
    return best, Camera(best.state.model, SIZE, theta_max=float(reach), covariance=covariance)


# -- how sure ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("fov", "warp"), [(180, False), (280, True)])
def test_simulated_calibrations_scatter_as_each_of_them_predicts(fov, warp):
    truth = lens(fov)
    exact = observe_boards(truth, fov, np.random.default_rng(0), count=10, noise=0.0)
    bearings = cap(np.radians(fov / 2) * 0.95, 6)
    pixels, _ = truth.project(bearings)
    true = {True: [], False: []}
    said = {True: [], False: []}
    angles, turned = [], []
    for seed in range(SIMULATED):
        _, camera = one(truth.name, truth, noisy(exact, seed), warp=warp)
        uncertainty = Uncertainty.of(camera)
        for free in (True, False):
            said[free].append(np.trace(uncertainty.projection(bearings, aligned=free), axis1=1, axis2=2))
        true[True].append((rotation_aligned_difference(camera.model, bearings, pixels) ** 2).sum(1))
        true[False].append(((camera.project(bearings)[0] - pixels) ** 2).sum(1))
        angles.append(uncertainty.bearing(bearings, aligned=False) ** 2)
        turned.append(np.arccos(np.clip((camera.unproject(pixels)[0] * bearings).sum(1), -1, 1)) ** 2)
    for free in (True, False):
        ratio = np.sqrt(np.mean(said[free], 0) / np.mean(true[free], 0))
        assert ((ratio > 0.85) & (ratio < 1.15)).all(), (free, ratio.min(), ratio.max())
        # And nearly each of them alone, over the field.
        alone = np.sqrt(np.mean(said[free], 1) / np.mean(true[free]))
        assert np.mean((alone > 0.85) & (alone < 1.15)) > 0.9, np.quantile(alone, [0.0, 0.05, 0.5, 0.95, 1.0])
    ratio = np.sqrt(np.mean(angles, 0) / np.mean(turned, 0))
    assert ((ratio > 0.85) & (ratio < 1.15)).all(), ("bearing", ratio.min(), ratio.max())


def shared(exact, seed):
    """See corners off together, another way in every image, as a board that bends in the hand has them."""
    rng = np.random.default_rng(seed)
    views = []
    for x, p in exact:
        across, down = ((x - x.mean(0)) / np.ptp(x, axis=0).max())[:, :2].T
        bend = np.stack([across**2, across * down, down**2], 1) @ rng.normal(0, 1.0, (3, 2))
        views.append((x, p + bend + rng.normal(0, 0.1, p.shape)))
    return observe(views)


@pytest.mark.parametrize("count", [6, 14])
def test_errors_that_the_corners_of_a_picture_share_are_in_what_a_camera_says_of_itself(count):
    truth = lens(180)
    exact = observe_boards(truth, 180, np.random.default_rng(0), count=count, noise=0.0)
    bearings = cap(1.4, 6)
    pixels, _ = truth.project(bearings)
    true, said, noise, times = [], [], [], []
    for seed in range(60):
        views = shared(exact, seed)
        best, camera = one(truth.name, truth, views)
        true.append((rotation_aligned_difference(camera.model, bearings, pixels) ** 2).sum(1))
        said.append(np.trace(Uncertainty.of(camera).projection(bearings), axis1=1, axis2=2))
        plain = dataclasses.replace(camera, covariance=noise_covariance(best, views))
        noise.append(np.trace(Uncertainty.of(plain).projection(bearings), axis1=1, axis2=2))
        times.append(view_scatter(best, views))
    assert np.sqrt(np.mean(said) / np.mean(true)) == pytest.approx(1, abs=0.2)
    assert np.sqrt(np.mean(noise) / np.mean(true)) < 0.5
    assert np.median(times) > 4


def test_pictures_that_differ_by_noise_alone_scatter_as_noise():
    truth = lens(180)
    exact = observe_boards(truth, 180, np.random.default_rng(0), count=14, noise=0.0)
    times = [
        view_scatter(one(truth.name, truth, views)[0], views) for views in (noisy(exact, seed) for seed in range(20))
    ]
    assert np.mean(times) == pytest.approx(1, abs=0.25)


def test_one_picture_is_as_sure_as_noise_has_it():
    truth = lens(180)
    views = noisy(observe_boards(truth, 180, np.random.default_rng(0), count=1, noise=0.0), 0)
    best, camera = one(truth.name, truth, views)
    np.testing.assert_allclose(camera.covariance, noise_covariance(best, views), rtol=1e-4)


def test_a_bearing_is_as_sure_as_its_pixel_over_the_focal_length():
    model = model_class("equidistant")(300.0, 300.0, 480.0, 480.0)
    covariance = np.diag([0.0, 0.0, 0.25, 0.0])  # the centre, half a pixel to the side
    uncertainty = Uncertainty.of(Camera(model, SIZE, theta_max=1.2, covariance=covariance))
    bearings = polar(np.array([0.0, 0.4, 1.1]), np.zeros(3))
    np.testing.assert_allclose(np.sqrt(uncertainty.projection(bearings, aligned=False)[:, 0, 0]), 0.5)
    np.testing.assert_allclose(uncertainty.bearing(bearings, aligned=False), 0.5 / 300)
    # A centre beside its place is a turn of the camera, and on the axis nothing else.
    turned = np.sqrt(np.trace(uncertainty.projection(bearings), axis1=1, axis2=2))
    assert (turned < 0.25).all()


def test_more_noise_and_fewer_pictures_are_less_sure():
    truth = lens(180)
    exact = observe_boards(truth, 180, np.random.default_rng(0), count=16, noise=0.0)

    def worst(views):
        return UncertaintyMap.of(one("equisolid", truth, views)[1]).worst()[0]

    usual = worst(noisy(exact, 0))
    assert worst(noisy(exact, 0, 2 * NOISE)) == pytest.approx(2 * usual, rel=0.1)
    assert worst(noisy(exact[::4], 0)) > 1.5 * usual


def test_beyond_the_corners_the_map_says_so_and_is_less_sure():
    truth = lens(200)
    views = noisy(observe_boards(truth, 120, np.random.default_rng(0), count=12, noise=0.0), 0)
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


def of_model(camera):
    return lambda model, covariance: dataclasses.replace(camera, model=model, covariance=covariance)


def test_halves_differ_as_predicted_where_there_is_only_noise():
    truth = lens(180)
    exact = observe_boards(truth, 180, np.random.default_rng(0), count=12, noise=0.0)
    ratios = []
    for seed in range(12):
        views = noisy(exact, seed)
        best, camera = one("equisolid", truth, views)
        found = run_split_half_test(best, views, of_model(camera), loss="huber")
        assert found is not None
        ratios.append(found.ratio)
    assert 0.6 < np.mean(ratios) < 1.3


def test_halves_of_very_many_corners_are_calibrated_too():
    truth = lens(180)
    exact = observe_boards(truth, 180, np.random.default_rng(0), count=12, noise=0.0)
    shaken = np.random.default_rng(1)
    views = [(np.tile(x, (60, 1)), np.tile(p, (60, 1))) for x, p in exact]
    views = observe([(x, p + shaken.normal(0, NOISE, p.shape)) for x, p in views])
    assert len(views.pixels) > 30_000
    best, camera = one("equisolid", truth, views)
    assert 0.3 < run_split_half_test(best, views, of_model(camera), loss="huber").ratio < 3


def test_halves_betray_a_model_that_is_too_poor_and_the_covariance_makes_up_for_it():
    truth = lens(200)
    views = noisy(observe_boards(truth, 200, np.random.default_rng(0), count=16, noise=0.0), 0, 0.05)
    found = calibrate(views, model="stereographic", flat=True)
    halves = found.quality.split_half
    assert halves is not None
    assert halves.ratio > 3
    assert any("Two halves of the images give cameras" in reason for reason in found.verdict.reasons)
    assert any("the model is too poor for this lens: try --model auto" in r for r in found.verdict.reasons)
    # Each half has half of the images, and both are off: twice what the camera of all is.
    assert found.quality.uncertainty.rms() > 0.25 * halves.difference


def test_few_pictures_have_no_halves():
    _, found = calibrate_lens(180, 0, 7, model="equisolid")
    assert found.quality.split_half is None


# -- what the model leaves ---------------------------------------------------------------------------------------


def test_the_spline_shows_what_a_poor_model_leaves_and_where():
    truth = lens(200)
    views = noisy(observe_boards(truth, 200, np.random.default_rng(0), count=16, noise=0.0), 0, 0.05)
    poor = calibrate(views, model="equidistant", flat=True)
    fine = calibrate(views, model="kannala_brandt", flat=True)
    left, none = poor.quality.spline_baseline, fine.quality.spline_baseline
    assert left is not None
    assert none is not None
    assert left.left > 0.8 * poor.held_out_rms
    assert f"the model leaves {left.left:.3f} px" in str(left)
    assert none.left < 0.3 * fine.held_out_rms
    assert left.spline_rms.max() < 0.2
    held_out = poor.best.held_out_lengths[~poor.outliers]
    angles = angle_from_axis(poor.state.points(views)[0])[~poor.outliers]
    ring = (angles >= left.edges[left.where]) & (angles <= left.edges[left.where + 1])
    assert np.sqrt((held_out[ring] ** 2).mean()) == pytest.approx(left.model_rms[left.where], rel=0.05)


def test_a_spline_that_pictures_do_not_tell_says_nothing_about_the_model():
    found = calibrate_camera(
        noisy(observe_boards(lens(180), 180, np.random.default_rng(0), count=4, noise=0.0), 0, 0.1),
        SIZE,
        model="equisolid",
    )
    ceiling = found.quality.spline_baseline
    assert ceiling.candidate.held_out_rms > 1.5 * found.held_out_rms
    assert "so few images tell no spline" in str(ceiling)
    assert "what the model leaves is open" in str(ceiling)


# -- a board that is not flat ------------------------------------------------------------------------------------


def bent(exact_warp, seed=0, noise=0.1, fov=180, count=12):
    """See boards whose middle stands off the plane of their edges."""
    truth = lens(fov)
    flat = observe(observe_boards(truth, fov, np.random.default_rng(seed), count=count, noise=0.0))
    state = dataclasses.replace(resect(truth, flat), warp=np.array(exact_warp, float))
    pixels, _ = truth.project(state.points(flat)[0])
    rng = np.random.default_rng(seed)
    return observe([(flat.points[g], pixels[g] + rng.normal(0, noise, pixels[g].shape)) for g in flat.groups])


def test_a_bent_board_is_found_bent_and_the_camera_is_better_for_it():
    views = bent((0.08, -0.05))
    found = calibrate(views, model="equisolid")
    np.testing.assert_allclose(found.state.warp, (0.08, -0.05), atol=0.012)
    np.testing.assert_allclose(found.camera.calibration["board_warp"], found.state.warp)
    assert found.rms == pytest.approx(0.1 * np.sqrt(2), rel=0.1)
    flat = calibrate(views, model="equisolid", flat=True)
    assert not flat.state.warp.any()
    assert flat.held_out_rms > 1.2 * found.held_out_rms

    def error(calibration):
        bearings = cap(1.4, 8)
        off = rotation_aligned_difference(calibration.camera.model, bearings, lens(180).project(bearings)[0])
        return np.sqrt((off**2).sum(1).mean())

    assert error(found) < 0.7 * error(flat)


def test_a_flat_board_is_left_flat():
    for seed in range(3):
        found = calibrate(bent((0.0, 0.0), seed), model="equisolid")
        assert not found.state.warp.any()
        assert "board_warp" not in found.camera.calibration


# -- square pixels -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", ["equisolid", "mei", "kannala_brandt", "ocam"])
def test_square_pixels_have_one_focal_length(model):
    _, found = calibrate_lens(180, 0, model=model, square_pixels=True)
    values = found.camera.model.to_dict()
    if model == "ocam":
        assert (values["c"], values["d"], values["e"]) == (1.0, 0.0, 0.0)
    else:
        assert values["fx"] == values["fy"]
        rows = found.camera.covariance[:2]
        np.testing.assert_allclose(rows[0], rows[1])
    assert found.rms < 1.1 * NOISE * np.sqrt(2)
    free = calibrate_lens(180, 0, model=model)[1].candidates[0]
    assert found.candidates[0].parameters == free.parameters - (2 if model == "ocam" else 1)
