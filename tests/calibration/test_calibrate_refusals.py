"""Calibration from corners: what it doubts, and what it refuses."""

import numpy as np
import pytest

from lenses import BOARD, NOISE_RMS, SIZE, lens, observe_boards, calibrate_first_views
from omnisight.geometry import rotation as so3
from omnisight.models import model_names
from omnisight.pipeline.central import calibrate_camera
from omnisight.targets.observations import Observations


def test_too_few_pictures_are_refused_with_the_number_and_the_remedy():
    with pytest.raises(ValueError, match=r"2 images with a board are too few: 3 is the least.*tilted"):
        calibrate_first_views(2)
    forced = calibrate_first_views(2, force=True)
    assert forced.rms < NOISE_RMS * 1.1
    assert forced.held_out_rms is None
    assert "too few images to hold any out" in forced.reason


@pytest.mark.parametrize("images", [1, 2])
def test_a_forced_calibration_takes_few_parameters_and_is_doubted(images):
    forced = calibrate_first_views(images, force=True)
    assert forced.candidates[0].parameters <= 6
    assert str(forced.verdict) == "do not use"
    assert "leave" in forced.verdict.reasons[0]


@pytest.mark.parametrize("force", [False, True])
def test_no_picture_at_all_is_refused_even_by_force(force):
    with pytest.raises(ValueError, match="0 images with a board are too few"):
        calibrate_camera(Observations.of([]), SIZE, force=force)


def test_a_picture_without_corners_is_refused_by_its_name():
    view = observe_boards(lens(180), 180, np.random.default_rng(0))[3]
    with pytest.raises(ValueError, match=r"b\.png: has no corners; leave it out"):
        Observations.of([view, (np.zeros((0, 3)), np.zeros((0, 2)))], ["a.png", "b.png"])


def test_copies_of_a_picture_are_refused_and_named():
    view = observe_boards(lens(180), 180, np.random.default_rng(0))[3]
    views = Observations.of([view] * 3, ["a.png", "b.png", "c.png"])
    said = r"3 images with a board, but only 1 that differ \(a\.png = b\.png, a\.png = c\.png\): 3 is.*--force"
    with pytest.raises(ValueError, match=said):
        calibrate_camera(views, SIZE)
    found = calibrate_camera(views, SIZE, model="kannala_brandt", force=True)
    (same,) = [reason for reason in found.verdict.reasons if "repeat" in reason]
    assert str(found.verdict) == "do not use"
    assert "that repeat another one: 2 (a.png = b.png, a.png = c.png)" in same
    assert "move the board" in same


def test_boards_that_never_tilt_are_doubted_with_the_angle():
    truth = lens(60)
    middle = BOARD.points.mean(0)
    rng = np.random.default_rng(0)
    views = []
    for x, y, distance in ((0, 0, 14), (3, 1, 16), (-3, 2, 18), (1, -3, 15), (-2, -2, 17)):
        points = (BOARD.points - middle) @ so3.exp([0.0, 0.0, x / 3]).T + [x, y, distance]
        pixels, _ = truth.project(points)
        views.append((BOARD.points, pixels + rng.normal(0, 0.05, pixels.shape)))
    found = calibrate_camera(Observations.of(views), SIZE, model="pinhole")
    assert str(found.verdict) == "do not use"
    (tilt,) = [reason for reason in found.verdict.reasons if "tilt only" in reason]
    assert tilt.startswith("The boards tilt only ")
    assert float(tilt.split("only ")[1].split()[0]) < 10
    assert "tilted by 30 to 45 degrees" in tilt
    assert "leaves the focal length open (+-1000 % or more)" in tilt


def test_an_unknown_model_lists_those_there_are():
    with pytest.raises(ValueError, match="unknown camera model 'fisheye9'") as said:
        calibrate_first_views(8, model="fisheye9")
    assert all(name in str(said.value) for name in ("auto", *model_names()))


def test_an_unknown_loss_is_refused():
    with pytest.raises(ValueError, match="loss must be 'huber' or 'squared', got 'cauchy'"):
        calibrate_first_views(8, model="equisolid", loss="cauchy")


@pytest.mark.parametrize("options", [{"fixed": ("skwe",)}, {"free": ("skwe",)}])
def test_a_parameter_that_the_model_lacks_is_refused(options):
    with pytest.raises(ValueError, match="unified has no skwe; it has fx, fy, cx, cy, xi, skew"):
        calibrate_first_views(8, model="unified", **options)


def hopeless():
    """Give corners that no camera explains, and a model that cannot reach the corners it is given."""
    rng = np.random.default_rng(0)
    noise = [(BOARD.points, rng.uniform(0, 960, (BOARD.size, 2))) for _ in range(6)]
    return {"noise": (noise, "kannala_brandt"), "pinhole": (observe_boards(lens(280), 280, rng), "pinhole")}


@pytest.mark.parametrize("case", ["noise", "pinhole"])
def test_what_explains_nothing_is_not_called_a_camera_without_a_word(case):
    views, model = hopeless()[case]
    try:
        found = calibrate_camera(Observations.of(views), SIZE, model=model)
    except ValueError as error:
        said = str(error)
    else:
        said = " ".join(found.verdict.reasons)
        assert str(found.verdict) == "do not use"
    assert "explain" in said or "describe" in said


def test_the_corners_given_are_left_alone():
    views = observe_boards(lens(180), 180, np.random.default_rng(0))
    before = [(x.copy(), p.copy()) for x, p in views]
    calibrate_camera(Observations.of(views), SIZE, model="equisolid")
    assert all(
        np.array_equal(a, b) for old, new in zip(before, views, strict=True) for a, b in zip(old, new, strict=True)
    )
