"""Calibration from corners: errors and warnings for insufficient or wrong input."""

import numpy as np
import pytest

from calibrating import calibrate, observe
from lenses import BOARD, NOISE_RMS, calibrate_first_views, lens, observe_boards
from omnisight.geometry import rotation as so3
from omnisight.models import model_names


def test_too_few_images_are_an_error_with_their_number_and_advice():
    with pytest.raises(ValueError, match=r"2 images with a board: at least 3 are needed, .* with the board tilted"):
        calibrate_first_views(2)
    forced = calibrate_first_views(2, force=True)
    assert forced.rms < NOISE_RMS * 1.1
    assert forced.held_out_rms is None
    assert "too few images for a cross-validation" in forced.selection.reason


@pytest.mark.parametrize("images", [1, 2])
def test_forced_calibration_has_few_parameters_and_is_not_to_be_used(images):
    forced = calibrate_first_views(images, force=True)
    assert forced.best.parameters <= 6
    assert str(forced.verdict) == "do not use"
    assert "not determine all parameters" in forced.reasons[0]


@pytest.mark.parametrize(("force", "required"), [(False, 3), (True, 1)])
def test_no_images_are_an_error_even_with_force(force, required):
    with pytest.raises(ValueError, match=f"0 images with a board: at least {required} are needed"):
        calibrate(observe([]), force=force)


def test_view_without_corners_is_an_error_with_its_name():
    view = observe_boards(lens(180), 180, np.random.default_rng(0))[3]
    with pytest.raises(ValueError, match=r"b\.png: has no corners; leave it out"):
        observe([view, (np.zeros((0, 3)), np.zeros((0, 2)))], names=["a.png", "b.png"])


def test_copies_of_one_image_are_an_error_with_their_names():
    view = observe_boards(lens(180), 180, np.random.default_rng(0))[3]
    observations = observe([view] * 3, names=["a.png", "b.png", "c.png"])
    message = r"3 images with a board, of which only 1 is distinct \(a\.png = b\.png, a\.png = c\.png\).*--force"
    with pytest.raises(ValueError, match=message):
        calibrate(observations)
    forced = calibrate(observations, model="kannala_brandt", force=True)
    (reason,) = [reason for reason in forced.reasons if "repeat" in reason]
    assert str(forced.verdict) == "do not use"
    assert "2 images repeat another one (a.png = b.png, a.png = c.png)" in reason
    assert "move the board" in reason


def test_parallel_boards_are_not_to_be_used_and_the_reason_states_their_tilt():
    truth = lens(60)
    middle = BOARD.points.mean(0)
    rng = np.random.default_rng(0)
    views = []
    for x, y, distance in ((0, 0, 14), (3, 1, 16), (-3, 2, 18), (1, -3, 15), (-2, -2, 17)):
        points = (BOARD.points - middle) @ so3.exp([0.0, 0.0, x / 3]).T + [x, y, distance]
        pixels, _ = truth.project(points)
        views.append((BOARD.points, pixels + rng.normal(0, 0.05, pixels.shape)))
    calibration = calibrate(observe(views), model="pinhole")
    assert str(calibration.verdict) == "do not use"
    (tilt,) = [reason for reason in calibration.reasons if "tilted by only" in reason]
    assert float(tilt.split("by only ")[1].split("°")[0]) < 10
    assert "tilted by 30° to 45° in both directions" in tilt
    assert "does not determine the focal length (above ±1000 %)" in tilt


def test_unknown_model_is_an_error_that_lists_the_known_ones():
    with pytest.raises(ValueError, match="unknown camera model 'fisheye9'") as error:
        calibrate_first_views(8, model="fisheye9")
    assert len(model_names()) > 10
    assert all(name in str(error.value) for name in ("auto", "axial", *model_names()))


def test_unknown_loss_is_an_error():
    with pytest.raises(ValueError, match="--loss: unknown choice 'cauchy'; there are: huber, squared"):
        calibrate_first_views(8, model="equisolid", loss="cauchy")


@pytest.mark.parametrize("options", [{"fix": ("skwe",)}, {"free": ("skwe",)}])
def test_unknown_parameter_is_an_error_that_lists_the_known_ones(options):
    known = r"skwe \(did you mean skew\?\); there are: fx, fy, cx, cy, xi, skew"
    with pytest.raises(ValueError, match=f"has a parameter {known}"):
        calibrate_first_views(8, model="unified", **options)


def unsuitable_views():
    """Return corners that no camera fits, and a model that cannot represent the lens of its corners."""
    rng = np.random.default_rng(0)
    noise = [(BOARD.points, rng.uniform(0, 960, (BOARD.size, 2))) for _ in range(6)]
    return {"noise": (noise, "kannala_brandt"), "pinhole": (observe_boards(lens(280), 280, rng), "pinhole")}


@pytest.mark.parametrize("case", ["noise", "pinhole"])
def test_corners_that_no_camera_fits_are_an_error_or_not_to_be_used(case):
    views, model = unsuitable_views()[case]
    try:
        calibration = calibrate(observe(views), model=model)
    except ValueError as error:
        message = str(error)
    else:
        message = " ".join(calibration.reasons)
        assert str(calibration.verdict) == "do not use"
    assert any(words in message for words in ("no camera explains", "cannot represent", "does not fit"))


def test_input_arrays_are_not_modified():
    views = observe_boards(lens(180), 180, np.random.default_rng(0))
    copies = [(x.copy(), p.copy()) for x, p in views]
    calibrate(observe(views), model="equisolid")
    assert len(views) == len(copies) > 0
    for view, copy in zip(views, copies, strict=True):
        assert np.array_equal(view[0], copy[0])
        assert np.array_equal(view[1], copy[1])
