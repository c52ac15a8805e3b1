"""Calibration from corners: which parameters are estimated, their covariance, and the figures of the camera file."""

import numpy as np
import pytest

from calibrating import calibrate, observe
from lenses import BOARD, CENTRE, NOISE, NOISE_RMS, bearing_error, calibrate_lens, lens, observe_boards
from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.estimation_options import EstimationOptions
from omnisight.calibration.initial_camera import estimate_initial_camera
from omnisight.calibration.model_selection import fit_candidates
from omnisight.calibration.resection import resect


def skewed():
    truth = lens(280, skew=4.0)
    return truth, observe(observe_boards(truth, 280, np.random.default_rng(1), count=10))


def test_skew_is_constant_unless_free():
    truth, observations = skewed()
    constant = calibrate(observations, model="unified")
    free = calibrate(observations, model="unified", free=("skew",))
    assert constant.camera.model.skew == 0
    assert free.camera.model.skew == pytest.approx(truth.skew, abs=0.5)
    assert free.rms < 1.1 * NOISE_RMS < constant.rms
    assert free.best.parameters == constant.best.parameters + 1


def test_fixed_parameter_is_not_estimated_and_has_no_variance():
    truth, observations = skewed()
    calibration = calibrate(observations, model="unified", free=("skew",), fix=("xi",))
    index = calibration.camera.model.param_names.index("xi")
    assert calibration.best.parameters == truth.params.size - 1
    assert np.all(calibration.camera.covariance[index] == 0)
    assert np.all(np.delete(np.diag(calibration.camera.covariance), index) > 0)


def fit(name, initial, observations, **options):
    """Fit a model in all its variants, given an initial camera; return the cameras, the lowest rms first."""
    candidates = fit_candidates([name], initial, observations, EstimationOptions(**options), lambda *_: None)
    return [candidate.state.model for candidate in sorted(candidates, key=lambda candidate: candidate.rms)]


@pytest.mark.parametrize("model", ["unified", "mei", "ocam", "kannala_brandt", "rational", "fisheye624"])
def test_fixed_parameters_keep_their_initial_values(model):
    observations = observe(observe_boards(lens(140), 140, np.random.default_rng(2)))
    known = fit(model, estimate_initial_camera(observations), observations)[0]
    known = known.from_dict(known.to_dict() | {"cx": CENTRE[0] + 2, "cy": CENTRE[1] - 1})
    variants = fit(model, resect(known, observations), observations, fix=("cx", "cy"))
    assert variants
    for fitted in variants:
        assert (fitted.cx, fitted.cy) == (known.cx, known.cy)
        assert fitted != known


@pytest.mark.parametrize("fixed", ["fx", "fy"])
def test_square_pixels_take_the_fixed_focal_length(fixed):
    observations = observe(observe_boards(lens(140), 140, np.random.default_rng(2)))
    (known,) = fit("kannala_brandt", estimate_initial_camera(observations), observations)
    known = known.from_dict(known.to_dict() | {fixed: 1.001 * known.fx})
    (fitted,) = fit(known.name, resect(known, observations), observations, fix=(fixed,), square_pixels=True)
    assert fitted.fx == fitted.fy == getattr(known, fixed)


@pytest.mark.parametrize("model", ["equisolid", "mei", "kannala_brandt", "ocam"])
def test_square_pixels_have_one_focal_length(model):
    _, calibration = calibrate_lens(180, 0, model=model, square_pixels=True)
    values = calibration.camera.model.to_dict()
    if model == "ocam":
        assert (values["c"], values["d"], values["e"]) == (1.0, 0.0, 0.0)
    else:
        assert values["fx"] == values["fy"]
        rows = calibration.camera.covariance[:2]
        np.testing.assert_allclose(rows[0], rows[1])
    assert calibration.rms < 1.1 * NOISE_RMS
    free = calibrate_lens(180, 0, model=model)[1].best
    assert calibration.best.parameters == free.parameters - (2 if model == "ocam" else 1)


def test_squared_loss_has_the_least_rms_and_huber_loss_the_better_camera():
    truth = lens(180)
    rng = np.random.default_rng(3)
    views = observe_boards(truth, 180, rng)
    for _, pixels in views:
        pixels[rng.random(len(pixels)) < 0.05] += 6
    observations = observe(views)
    squared, huber = (calibrate(observations, model="equisolid", loss=loss) for loss in ("squared", "huber"))
    assert squared.rms <= huber.rms
    assert huber.mean < squared.mean
    theta_max = 0.95 * np.radians(90)
    assert bearing_error(huber.camera, truth, theta_max) < bearing_error(squared.camera, truth, theta_max)


def test_covariance_predicts_the_standard_deviations_of_repeated_calibrations():
    truth, first = calibrate_lens(240, 0, model="double_sphere")
    predicted = np.sqrt(np.diag(first.camera.covariance))
    exact = observe_boards(truth, 240, np.random.default_rng(0), noise=0.0)
    params = []
    for seed in range(25):
        rng = np.random.default_rng(seed)
        observations = observe([(x, p + rng.normal(0, NOISE, p.shape)) for x, p in exact])
        params.append(refine(first.state, observations).state.model.params)
    ratio = np.std(params, axis=0, ddof=1) / predicted
    assert np.all((ratio > 1 / 1.5) & (ratio < 1.5)), ratio
    # The mean is unbiased.
    assert np.all(np.abs(np.mean(params, axis=0) - truth.params) < 4 * predicted / np.sqrt(25))


def test_camera_stores_the_figures_of_the_calibration():
    _, calibration = calibrate_lens(180, 0)
    figures = calibration.camera.calibration
    assert figures["verdict"] == str(calibration.verdict)
    assert figures["reasons"] == list(calibration.reasons)
    assert figures["uncertainty_px"] == calibration.quality.uncertainty.worst()[0]
    assert "board_warp" not in figures
    assert {name: figures[name] for name in ("rms", "mean", "held_out_rms", "images", "corners", "outliers")} == {
        "rms": calibration.rms,
        "mean": calibration.mean,
        "held_out_rms": calibration.held_out_rms,
        "images": 8,
        "corners": 8 * BOARD.size,
        "outliers": 0,
    }
    lengths = calibration.residual_lengths
    assert calibration.rms == pytest.approx(np.sqrt((lengths**2).mean()))
    assert calibration.mean == pytest.approx(lengths.mean())


def test_progress_reports_the_stages_and_equal_corners_give_equal_cameras():
    calls = []
    truth, first = calibrate_lens(140, 0)
    observations = observe(observe_boards(truth, 140, np.random.default_rng(0)))
    second = calibrate(observations, progress=lambda *call: calls.append(call))
    assert list(dict.fromkeys(stage for stage, _, _ in calls)) == ["fit models", "cross-validate"]
    assert all(0 <= done <= total for _, done, total in calls)
    assert np.array_equal(first.camera.model.params, second.camera.model.params)
    assert {"detect", "redetect", "solve", "total"} == set(second.seconds)
