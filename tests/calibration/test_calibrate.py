"""Calibration from corners: it starts by itself on every lens and mirror, and finds out what it is."""

import json
from dataclasses import replace

import numpy as np
import pytest

from lenses import CENTRE, LENSES, NOISE_RMS, SIZE, bearing_error, calibrate_lens, lens, observe_boards
from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.candidate import ENOUGH, FOLDS
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.pipeline.central import calibrate_camera
from omnisight.targets import Checkerboard
from omnisight.targets.observations import Observations

# -- it starts by itself -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("fov", "seed"), [*((fov, 0) for fov in LENSES), (60, 1), (180, 1), (280, 1)])
def test_every_field_of_view_starts_without_a_guess_and_ends_at_the_noise(fov, seed):
    truth, found = calibrate_lens(fov, seed)
    # 8 images of 54 corners leave the camera about 0.95 of the noise to explain.
    assert 0.85 * NOISE_RMS < found.rms < 1.1 * NOISE_RMS
    assert 0.8 * found.rms < found.mean < found.rms
    assert not found.outliers.any()
    assert bearing_error(found.camera, truth, 0.95 * found.camera.theta_max) < 0.3
    assert found.camera.size == SIZE
    assert np.radians(fov / 2) * 0.75 < found.camera.theta_max < np.radians(fov / 2) * 1.05
    assert not any(check.name in ("tilt", "residuals", "halves") and check.sentence for check in found.verdict.checks)


@pytest.mark.parametrize("fov", [60, 180, 280])
def test_wrong_corners_are_outvoted_and_named(fov):
    truth = lens(fov)
    rng = np.random.default_rng(3)
    views = observe_boards(truth, fov, rng)
    wrong = []
    for _, pixels in views:
        bad = rng.random(len(pixels)) < 0.1
        pixels[bad] += rng.uniform(8, 40, (bad.sum(), 1)) * rng.choice([-1, 1], (bad.sum(), 2))
        wrong.append(bad)
    found = calibrate_camera(Observations.of(views), SIZE)
    assert np.array_equal(found.outliers, np.concatenate(wrong))
    kept = found.residual_lengths[~found.outliers]
    assert np.sqrt((kept**2).mean()) < 1.2 * NOISE_RMS
    assert bearing_error(found.camera, truth, 0.95 * found.camera.theta_max) < 0.6
    assert found.camera.theta_max < np.radians(fov / 2) * 1.05


@pytest.mark.parametrize("fov", [100, 180, 240])
def test_a_centre_far_from_the_pictures_middle_is_found(fov):
    size = (960, 720)
    truth = lens(fov, centre=(690.0, 230.0))
    views = observe_boards(truth, fov, np.random.default_rng(5), count=14, size=size)
    found = calibrate_camera(Observations.of(views), size)
    assert found.rms < 1.1 * NOISE_RMS
    centre, _ = found.camera.project([0.0, 0.0, 1.0])
    assert np.linalg.norm(centre - (690.0, 230.0)) < 3
    assert bearing_error(found.camera, truth, 0.9 * found.camera.theta_max) < 0.2


@pytest.mark.parametrize("fov", LENSES)
def test_exact_corners_are_explained_exactly(fov):
    truth, found = calibrate_lens(fov, noise=0.0, model=LENSES[fov][0])
    assert found.rms < 1e-6
    assert bearing_error(found.camera, truth, found.camera.theta_max) < 1e-5


@pytest.mark.parametrize("handed", [1.0, -1.0])
def test_numbers_may_be_of_any_scale_and_the_board_seen_from_behind(handed):
    truth = lens(180)
    views = observe_boards(truth, 180, np.random.default_rng(0))
    flip = np.array([handed, 1.0])
    metres = [(points * 1e-3, (pixels - CENTRE) * flip + CENTRE) for points, pixels in views]
    found = calibrate_camera(Observations.of(metres), SIZE, model="equisolid")
    assert found.rms < 1.1 * NOISE_RMS
    assert np.linalg.norm(found.state.translations, axis=1).max() < 0.05


# -- which model -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fov", LENSES)
def test_auto_takes_what_represents_the_lens_and_says_why(fov):
    _, found = calibrate_lens(fov, 0)
    asked = [c for c in found.candidates if c.held_out_rms is not None]
    assert len(asked) >= 2
    chosen = found.candidates[[c.state is found.state for c in found.candidates].index(True)]
    assert chosen.name.split()[0] == found.camera.model.name
    assert found.held_out_rms == chosen.held_out_rms
    assert NOISE_RMS * 0.9 < found.held_out_rms < 1.1 * NOISE_RMS
    assert found.held_out_rms <= 1.0101 * min(c.held_out_rms for c in asked)
    # One sentence: the model, its figure, and what it was measured against.
    assert found.reason.startswith(f"{chosen.name}: {found.held_out_rms:.3f} px on images it was not calibrate_lens on")
    assert found.reason.endswith(".")
    assert ". " not in found.reason
    assert chosen is found.chosen is found.candidates[0]
    order = [c.held_out_rms for c in found.candidates[1:] if c.held_out_rms is not None]
    assert order == sorted(order)


def test_a_model_that_cannot_bend_so_far_is_worse_and_says_so_in_figures():
    _, plain = calibrate_lens(240, model="stereographic")
    _, good = calibrate_lens(240, model="double_sphere")
    assert plain.rms > 3 * good.rms
    assert plain.held_out_rms > 3 * good.held_out_rms


def test_candidates_hold_their_figures():
    _, found = calibrate_lens(140, 0)
    for candidate in found.candidates:
        figures = candidate.as_dict()
        assert set(figures) == {"model", "parameters", "corners", "rms", "mean", "held_out_rms"}
        assert figures["mean"] <= figures["rms"]
        assert figures["parameters"] == candidate.freedom.directions.shape[1]
    assert json.dumps([c.as_dict() for c in found.candidates])


@pytest.mark.parametrize("fov", [100, 180, 280])
def test_held_out_is_what_plain_refits_without_each_fifth_of_the_pictures_leave(fov):
    _, found = calibrate_lens(fov, 0)
    views = found.views
    for candidate in (c for c in found.candidates if c.held_out_rms is not None):
        lengths = np.empty(len(views.pixels))
        for k in range(FOLDS):
            out = np.arange(k, len(views), FOLDS)
            rest = np.setdiff1d(np.arange(len(views)), out)
            start, freedom = candidate.state.part(rest), candidate.freedom
            trained = refine(start, views.subset(rest), freedom=freedom, tolerance=1e-10).state
            posed = replace(candidate.state.part(out), model=trained.model, warp=trained.warp)
            posed = refine(posed, views.subset(out), freedom=FreeParameters.none(trained.model), tolerance=1e-10).state
            lengths[views.rows(out)] = posed.lengths(views.subset(out))
        assert candidate.held_out_rms == pytest.approx(np.sqrt((lengths**2).mean()), rel=5e-3), candidate.name


def test_of_many_corners_enough_compare_models_and_all_make_the_camera():
    views = Observations.of(observe_boards(lens(180), 180, np.random.default_rng(3), count=40))
    assert len(views.pixels) > ENOUGH
    found = calibrate_camera(views, SIZE)
    chosen = found.chosen
    assert chosen.corners == len(views.pixels)
    assert chosen.name == found.candidates[0].name
    assert all(ENOUGH * 0.9 < one.corners < ENOUGH * 1.1 for one in found.candidates)
    assert found.rms == pytest.approx(np.sqrt((chosen.state.lengths(views) ** 2).mean()))
    assert len(chosen.held_out_lengths) == len(views.pixels)
    assert f"compared on {found.candidates[0].corners} of {len(views.pixels)} corners" in found.reason
    assert 0.9 < found.trust.spline_baseline.candidate.corners / ENOUGH < 1.1
    # No other camera is nearer to the corners than one fitted to all of them.
    again = refine(chosen.state, views, freedom=chosen.freedom).state
    assert np.abs(again.model.params - found.camera.model.params).max() < 1e-3 * np.abs(again.model.params).max()


@pytest.mark.parametrize("model", ["unified", "eucm", "double_sphere", "kannala_brandt", "mei", "ocam", "division"])
def test_one_model_by_name(model):
    _, found = calibrate_lens(180, model=model)
    assert found.camera.model.name == model
    assert {c.name.split()[0] for c in found.candidates} == {model}


# -- real corners ------------------------------------------------------------------------------------------------

CORNERS = {
    "kaidan": (640, 480),
    "fish1": (1032, 778),
    "fstereo_left": (960, 600),
    "fstereo_right": (960, 600),
    "ai360_a": (1920, 1920),
    "derlunz": (1000, 750),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CORNERS)
def test_real_corners_are_explained_as_well_as_opencv_explains_them(data, name):
    # The sets of which OpenCV keeps every image, so that both figures are over the same corners.
    folder = data("corners")
    theirs = json.loads((folder / "opencv_omnidir.json").read_text())[name]
    assert theirs["used"] == theirs["views"]
    with np.load(folder / f"{name}.npz") as stored:
        columns, rows = (int(n) for n in stored["pattern"])
        corners = stored["corners"].astype(float)
    points = Checkerboard(columns, rows).points
    views = Observations.of([(points, pixels) for pixels in corners])
    found = calibrate_camera(views, CORNERS[name], model="mei", free=("skew",), loss="squared")
    assert found.rms <= 1.01 * theirs["mei_rms"]
