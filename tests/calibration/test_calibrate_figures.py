"""Calibration from corners: what moves, and how sure it is of it."""

import numpy as np
import pytest

from lenses import BOARD, CENTRE, NOISE, NOISE_RMS, SIZE, bearing_error, calibrate_lens, lens, observe_boards
from omnisight.calibration.bundle_adjustment import refine
from omnisight.pipeline.central import calibrate_camera
from omnisight.targets.observations import Observations

# -- what moves --------------------------------------------------------------------------------------------------


def skewed():
    truth = lens(280, skew=4.0)
    return truth, Observations.of(observe_boards(truth, 280, np.random.default_rng(1), count=10))


def test_a_skew_stands_still_unless_freed():
    truth, views = skewed()
    still = calibrate_camera(views, SIZE, model="unified")
    moved = calibrate_camera(views, SIZE, model="unified", free=("skew",))
    assert still.camera.model.skew == 0
    assert moved.camera.model.skew == pytest.approx(truth.skew, abs=0.5)
    assert moved.rms < 1.1 * NOISE_RMS < still.rms
    assert moved.candidates[0].parameters == still.candidates[0].parameters + 1


def test_a_fixed_parameter_is_not_estimated_and_has_no_deviation():
    truth, views = skewed()
    found = calibrate_camera(views, SIZE, model="unified", free=("skew",), fixed=("xi",))
    at = found.camera.model.param_names.index("xi")
    assert found.candidates[0].parameters == truth.params.size - 1
    assert np.all(found.camera.covariance[at] == 0)
    assert np.all(np.delete(np.diag(found.camera.covariance), at) > 0)


@pytest.mark.parametrize("model", ["unified", "mei", "ocam", "kannala_brandt", "rational", "fisheye624"])
def test_what_is_fixed_stays_where_a_known_camera_has_it(model):
    fov = 140
    views = Observations.of(observe_boards(lens(fov), fov, np.random.default_rng(2)))
    known = calibrate_camera(views, SIZE, model=model).camera.model
    known = known.from_dict(known.to_dict() | {"cx": CENTRE[0] + 2, "cy": CENTRE[1] - 1})
    found = calibrate_camera(views, SIZE, model=model, start=known, fixed=("cx", "cy")).camera.model
    assert (found.cx, found.cy) == (known.cx, known.cy)
    assert found != known


@pytest.mark.parametrize("fixed", ["fx", "fy"])
def test_square_pixels_have_the_focal_length_that_is_fixed(fixed):
    fov = 140
    views = Observations.of(observe_boards(lens(fov), fov, np.random.default_rng(2)))
    known = calibrate_camera(views, SIZE, model="kannala_brandt").camera.model
    known = known.from_dict(known.to_dict() | {fixed: 1.001 * known.fx})
    found = calibrate_camera(views, SIZE, model="kannala_brandt", start=known, fixed=(fixed,), square=True)
    assert found.camera.model.fx == found.camera.model.fy == getattr(known, fixed)


def test_least_squares_has_the_least_squares():
    truth = lens(180)
    rng = np.random.default_rng(3)
    views = observe_boards(truth, 180, rng)
    for _, pixels in views:
        pixels[rng.random(len(pixels)) < 0.05] += 6
    joined = Observations.of(views)
    squared, huber = (calibrate_camera(joined, SIZE, model="equisolid", loss=loss) for loss in ("squared", "huber"))
    assert squared.rms <= huber.rms
    assert huber.mean < squared.mean
    reach = 0.95 * np.radians(90)
    assert bearing_error(huber.camera, truth, reach) < bearing_error(squared.camera, truth, reach)


# -- how sure ----------------------------------------------------------------------------------------------------


def test_the_covariance_predicts_the_spread():
    truth, first = calibrate_lens(240, 0, model="double_sphere")
    predicted = np.sqrt(np.diag(first.camera.covariance))
    exact = observe_boards(truth, 240, np.random.default_rng(0), noise=0.0)
    found = []
    for seed in range(25):
        rng = np.random.default_rng(seed)
        views = Observations.of([(x, p + rng.normal(0, NOISE, p.shape)) for x, p in exact])
        found.append(refine(first.state, views).state.model.params)
    ratio = np.std(found, axis=0, ddof=1) / predicted
    assert np.all((ratio > 1 / 1.5) & (ratio < 1.5)), ratio
    # And the estimate is not beside the truth.
    assert np.all(np.abs(np.mean(found, axis=0) - truth.params) < 4 * predicted / np.sqrt(25))


def test_the_cameras_figures_are_those_of_the_calibration():
    _, found = calibrate_lens(180, 0)
    figures = found.camera.calibration
    assert figures["verdict"] == str(found.verdict)
    assert figures["reasons"] == list(found.verdict.reasons)
    assert figures["uncertainty_px"] == found.trust.uncertainty.worst()[0]
    assert "board_warp" not in figures
    assert {name: figures[name] for name in ("rms", "mean", "held_out_rms", "images", "corners", "outliers")} == {
        "rms": found.rms,
        "mean": found.mean,
        "held_out_rms": found.held_out_rms,
        "images": 8,
        "corners": 8 * BOARD.size,
        "outliers": 0,
    }
    lengths = found.residual_lengths
    assert found.rms == pytest.approx(np.sqrt((lengths**2).mean()))
    assert found.mean == pytest.approx(lengths.mean())


def test_progress_tells_its_stages_and_the_same_corners_give_the_same_camera():
    told = []
    truth, first = calibrate_lens(140, 0)
    views = Observations.of(observe_boards(truth, 140, np.random.default_rng(0)))
    second = calibrate_camera(views, SIZE, progress=lambda *state: told.append(state))
    assert list(dict.fromkeys(stage for stage, _, _ in told)) == ["start", "fit", "hold out", "judge"]
    assert all(0 <= done <= total for _, done, total in told)
    assert np.array_equal(first.camera.model.params, second.camera.model.params)
