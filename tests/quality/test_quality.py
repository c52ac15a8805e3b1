"""Uncertainty, split-half test, spline baseline and board warp against simulated calibrations."""

import dataclasses

import numpy as np
import pytest

from calibrating import SIZE, calibrate, observe
from lenses import NOISE, calibrate_lens, lens, observe_boards
from omnisight.calibration.candidate import Candidate
from omnisight.calibration.covariance import camera_covariance, noise_covariance, view_scatter
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.resection import resect
from omnisight.calibration.rotation_alignment import rotation_aligned_difference
from omnisight.camera import Camera
from omnisight.geometry.sphere import angle_from_axis, cap, polar
from omnisight.models import model_class
from omnisight.quality.split_half import run_split_half_test
from omnisight.quality.uncertainty import Uncertainty, UncertaintyMap

SIMULATIONS = 200


def with_noise(exact, seed, noise=NOISE):
    """Return observations of exact corners with noise (px)."""
    rng = np.random.default_rng(seed)
    return observe([(x, p + rng.normal(0, noise, p.shape)) for x, p in exact])


def fit(model, truth, views, **free_parameters):
    """Fit a model, started at the true camera; return the candidate, and the camera with covariance."""
    start = resect(truth, views)
    best = Candidate.fit(model, start, views, FreeParameters.of(start.model, **free_parameters), loss="huber")
    reach = angle_from_axis(best.state.points(views)[0]).max()
    covariance = camera_covariance(best, views)
    return best, Camera(best.state.model, SIZE, theta_max=float(reach), covariance=covariance)


@pytest.mark.parametrize(("fov", "warp"), [(180, False), (280, True)])
def test_errors_of_simulated_calibrations_match_their_uncertainty(fov, warp):
    truth = lens(fov)
    exact = observe_boards(truth, fov, np.random.default_rng(0), count=10, noise=0.0)
    bearings = cap(np.radians(fov / 2) * 0.95, 6)
    pixels, _ = truth.project(bearings)
    true = {True: [], False: []}
    stated = {True: [], False: []}
    stated_bearing, true_bearing = [], []
    for seed in range(SIMULATIONS):
        _, camera = fit(truth.name, truth, with_noise(exact, seed), warp=warp)
        uncertainty = Uncertainty.of(camera)
        for aligned in (True, False):
            stated[aligned].append(np.trace(uncertainty.projection(bearings, aligned=aligned), axis1=1, axis2=2))
        true[True].append((rotation_aligned_difference(camera.model, bearings, pixels) ** 2).sum(1))
        true[False].append(((camera.project(bearings)[0] - pixels) ** 2).sum(1))
        stated_bearing.append(uncertainty.bearing(bearings, aligned=False) ** 2)
        true_bearing.append(np.arccos(np.clip((camera.unproject(pixels)[0] * bearings).sum(1), -1, 1)) ** 2)
    for aligned in (True, False):
        ratio = np.sqrt(np.mean(stated[aligned], 0) / np.mean(true[aligned], 0))
        assert ((ratio > 0.85) & (ratio < 1.15)).all(), (aligned, ratio.min(), ratio.max())
        # The uncertainty of a single calibration, averaged over the field of view, is right in nine of ten cases.
        single = np.sqrt(np.mean(stated[aligned], 1) / np.mean(true[aligned]))
        assert np.mean((single > 0.85) & (single < 1.15)) > 0.9, np.quantile(single, [0.0, 0.05, 0.5, 0.95, 1.0])
    ratio = np.sqrt(np.mean(stated_bearing, 0) / np.mean(true_bearing, 0))
    assert ((ratio > 0.85) & (ratio < 1.15)).all(), ("bearing", ratio.min(), ratio.max())


def with_correlated_errors(exact, seed):
    """Return observations with smooth errors that differ by image, as of a board that bends while it is held."""
    rng = np.random.default_rng(seed)
    views = []
    for x, p in exact:
        across, down = ((x - x.mean(0)) / np.ptp(x, axis=0).max())[:, :2].T
        bend = np.stack([across**2, across * down, down**2], 1) @ rng.normal(0, 1.0, (3, 2))
        views.append((x, p + bend + rng.normal(0, 0.1, p.shape)))
    return observe(views)


@pytest.mark.parametrize("count", [6, 14])
def test_uncertainty_includes_errors_that_corners_of_an_image_share(count):
    truth = lens(180)
    exact = observe_boards(truth, 180, np.random.default_rng(0), count=count, noise=0.0)
    bearings = cap(1.4, 6)
    pixels, _ = truth.project(bearings)
    true, stated, noise_only, scatter = [], [], [], []
    for seed in range(60):
        views = with_correlated_errors(exact, seed)
        best, camera = fit(truth.name, truth, views)
        true.append((rotation_aligned_difference(camera.model, bearings, pixels) ** 2).sum(1))
        stated.append(np.trace(Uncertainty.of(camera).projection(bearings), axis1=1, axis2=2))
        plain = dataclasses.replace(camera, covariance=noise_covariance(best, views))
        noise_only.append(np.trace(Uncertainty.of(plain).projection(bearings), axis1=1, axis2=2))
        scatter.append(view_scatter(best, views))
    assert np.sqrt(np.mean(stated) / np.mean(true)) == pytest.approx(1, abs=0.2)
    assert np.sqrt(np.mean(noise_only) / np.mean(true)) < 0.5
    assert np.median(scatter) > 4


def test_view_scatter_of_pure_noise_is_one():
    truth = lens(180)
    exact = observe_boards(truth, 180, np.random.default_rng(0), count=14, noise=0.0)
    scatter = []
    for seed in range(20):
        views = with_noise(exact, seed)
        scatter.append(view_scatter(fit(truth.name, truth, views)[0], views))
    assert np.mean(scatter) == pytest.approx(1, abs=0.25)


def test_covariance_of_one_image_is_that_of_the_noise():
    truth = lens(180)
    views = with_noise(observe_boards(truth, 180, np.random.default_rng(0), count=1, noise=0.0), 0)
    best, camera = fit(truth.name, truth, views)
    np.testing.assert_allclose(camera.covariance, noise_covariance(best, views), rtol=1e-4)


def test_bearing_uncertainty_is_pixel_uncertainty_over_focal_length():
    model = model_class("equidistant")(300.0, 300.0, 480.0, 480.0)
    covariance = np.diag([0.0, 0.0, 0.25, 0.0])  # principal point, 0.5 px
    uncertainty = Uncertainty.of(Camera(model, SIZE, theta_max=1.2, covariance=covariance))
    bearings = polar(np.array([0.0, 0.4, 1.1]), np.zeros(3))
    np.testing.assert_allclose(np.sqrt(uncertainty.projection(bearings, aligned=False)[:, 0, 0]), 0.5)
    np.testing.assert_allclose(uncertainty.bearing(bearings, aligned=False), 0.5 / 300)
    # A shift of the principal point is nearly a rotation of the camera.
    aligned = np.sqrt(np.trace(uncertainty.projection(bearings), axis1=1, axis2=2))
    assert (aligned < 0.25).all()


def test_uncertainty_grows_with_noise_and_with_fewer_images():
    truth = lens(180)
    exact = observe_boards(truth, 180, np.random.default_rng(0), count=16, noise=0.0)

    def worst(views):
        return UncertaintyMap.of(fit("equisolid", truth, views)[1]).worst()[0]

    reference = worst(with_noise(exact, 0))
    assert worst(with_noise(exact, 0, 2 * NOISE)) == pytest.approx(2 * reference, rel=0.1)
    assert worst(with_noise(exact[::4], 0)) > 1.5 * reference


def test_uncertainty_map_marks_extrapolation_which_is_less_certain():
    truth = lens(200)
    views = with_noise(observe_boards(truth, 120, np.random.default_rng(0), count=12, noise=0.0), 0)
    _, camera = fit("kannala_brandt", truth, views)
    uncertainty = UncertaintyMap.of(camera)
    assert uncertainty.calibrated.any()
    assert not uncertainty.calibrated.all()
    assert uncertainty.theta[uncertainty.calibrated].max() == pytest.approx(camera.theta_max)
    last = uncertainty.visible.any(1).nonzero()[0][-1]
    assert np.nanmean(uncertainty.pixels[last]) > 5 * np.nanmax(uncertainty.pixels[uncertainty.calibrated])


def test_camera_without_covariance_is_an_error_with_advice():
    with pytest.raises(ValueError, match="no covariance: calibrate it with omnisight"):
        Uncertainty.of(Camera(lens(180), SIZE))


def camera_factory(camera):
    """Return the function that the split-half test needs: (model, covariance) -> camera."""
    return lambda model, covariance: dataclasses.replace(camera, model=model, covariance=covariance)


def test_halves_differ_as_predicted_for_pure_noise():
    truth = lens(180)
    exact = observe_boards(truth, 180, np.random.default_rng(0), count=12, noise=0.0)
    ratios = []
    for seed in range(12):
        views = with_noise(exact, seed)
        best, camera = fit("equisolid", truth, views)
        test = run_split_half_test(best, views, camera_factory(camera), loss="huber")
        assert test is not None
        ratios.append(test.ratio)
    assert 0.6 < np.mean(ratios) < 1.3


def test_split_half_test_works_with_very_many_corners():
    truth = lens(180)
    exact = observe_boards(truth, 180, np.random.default_rng(0), count=12, noise=0.0)
    rng = np.random.default_rng(1)
    # Sixty corners side by side, 1e-5 squares apart: far less than their noise.
    shifts = np.repeat(np.arange(60)[:, None] * (1e-5, 0.0, 0.0), len(exact[0][0]), axis=0)
    views = [(np.tile(x, (60, 1)) + shifts, np.tile(p, (60, 1))) for x, p in exact]
    views = observe([(x, p + rng.normal(0, NOISE, p.shape)) for x, p in views])
    assert len(views.pixels) > 30_000
    best, camera = fit("equisolid", truth, views)
    assert 0.3 < run_split_half_test(best, views, camera_factory(camera), loss="huber").ratio < 3


def test_halves_differ_more_than_predicted_for_a_model_that_does_not_fit():
    truth = lens(200)
    views = with_noise(observe_boards(truth, 200, np.random.default_rng(0), count=16, noise=0.0), 0, 0.05)
    calibration = calibrate(views, model="stereographic", flat=True)
    test = calibration.quality.split_half
    assert test is not None
    assert test.ratio > 3
    (reason,) = [reason for reason in calibration.reasons if "The cameras of two halves" in reason]
    assert "the model does not fit this lens: use --model spline (tried: held-out error " in reason
    # Each half has half of the images, and both have errors: the difference is twice the error of the camera.
    assert calibration.quality.uncertainty.rms() > 0.25 * test.difference


def test_split_half_test_needs_enough_images():
    _, calibration = calibrate_lens(180, 0, 7, model="equisolid")
    assert calibration.quality.split_half is None


def test_spline_baseline_shows_the_model_error_by_angle():
    truth = lens(200)
    views = with_noise(observe_boards(truth, 200, np.random.default_rng(0), count=16, noise=0.0), 0, 0.05)
    poor = calibrate(views, model="equidistant", flat=True)
    fine = calibrate(views, model="kannala_brandt", flat=True)
    baseline, fine_baseline = poor.quality.spline_baseline, fine.quality.spline_baseline
    assert baseline is not None
    assert fine_baseline is not None
    assert baseline.is_significant
    assert baseline.model_error > 0.8 * poor.held_out_rms
    assert f"model error {baseline.model_error:.3f} px" in str(baseline)
    assert fine_baseline.model_error < 0.3 * fine.held_out_rms
    assert baseline.spline_rms.max() < 0.2
    held_out = poor.best.held_out_lengths[~poor.outliers]
    angles = angle_from_axis(poor.state.points(views)[0])[~poor.outliers]
    worst = baseline.worst_ring
    ring = (angles >= baseline.edges[worst]) & (angles <= baseline.edges[worst + 1])
    assert np.sqrt((held_out[ring] ** 2).mean()) == pytest.approx(baseline.model_rms[worst], rel=0.05)


def test_unreliable_spline_baseline_leaves_the_model_error_unknown():
    exact = observe_boards(lens(180), 180, np.random.default_rng(0), count=4, noise=0.0)
    calibration = calibrate(with_noise(exact, 0, 0.1), model="equisolid")
    baseline = calibration.quality.spline_baseline
    assert not baseline.is_reliable
    assert baseline.candidate.held_out_rms > 1.5 * calibration.held_out_rms
    assert "not enough images to fit the spline baseline" in str(baseline)
    assert "model error unknown" in str(baseline)


def observe_warped_boards(exact_warp, seed=0, noise=0.1, fov=180, count=12):
    """Observe boards whose middle is off the plane of their edges."""
    truth = lens(fov)
    flat = observe(observe_boards(truth, fov, np.random.default_rng(seed), count=count, noise=0.0))
    state = dataclasses.replace(resect(truth, flat), warp=np.array(exact_warp, float))
    pixels, _ = truth.project(state.points(flat)[0])
    rng = np.random.default_rng(seed)
    return observe([(flat.points[g], pixels[g] + rng.normal(0, noise, pixels[g].shape)) for g in flat.groups])


def test_board_warp_is_estimated_and_improves_the_camera():
    views = observe_warped_boards((0.08, -0.05))
    calibration = calibrate(views, model="equisolid")
    np.testing.assert_allclose(calibration.state.warp, (0.08, -0.05), atol=0.012)
    np.testing.assert_allclose(calibration.camera.calibration["board_warp"], calibration.state.warp)
    assert calibration.rms == pytest.approx(0.1 * np.sqrt(2), rel=0.1)
    flat = calibrate(views, model="equisolid", flat=True)
    assert not flat.state.warp.any()
    assert flat.held_out_rms > 1.2 * calibration.held_out_rms

    def error(calibration):
        bearings = cap(1.4, 8)
        difference = rotation_aligned_difference(calibration.camera.model, bearings, lens(180).project(bearings)[0])
        return np.sqrt((difference**2).sum(1).mean())

    assert error(calibration) < 0.7 * error(flat)


def test_warp_of_a_flat_board_is_zero():
    for seed in range(3):
        calibration = calibrate(observe_warped_boards((0.0, 0.0), seed), model="equisolid")
        assert not calibration.state.warp.any()
        assert "board_warp" not in calibration.camera.calibration
