"""What is wrong with a calibration is said, and what to do; what is not wrong is left alone."""

import dataclasses

import numpy as np
import pytest

from lenses import BOARD, SIZE, calibrate_lens, lens, observe_boards
from omnisight.calibration.resection import resect
from omnisight.geometry import rotation as so3
from omnisight.geometry.sphere import polar
from omnisight.pipeline.central import calibrate_camera
from omnisight.quality.coverage import Coverage
from omnisight.targets.observations import Observations


def noisy(exact, noise):
    rng = np.random.default_rng(0)
    return Observations.of([(x, p + rng.normal(0, noise, p.shape)) for x, p in exact])


def test_a_good_set_is_called_good():
    _, found = calibrate_lens(180, 0, 16, noise=0.1)
    assert str(found.verdict) == "good"
    assert found.verdict.reasons == ()
    assert found.camera.calibration["verdict"] == "good"


def test_corners_on_one_side_only_are_called_so_and_the_side_is_named():
    truth = lens(180)
    seen = [
        (x, p) for x, p in observe_boards(truth, 180, np.random.default_rng(0), count=40) if p[:, 0].min() > SIZE[0] / 2 + 20
    ]
    assert len(seen) >= 6
    found = calibrate_camera(Observations.of(seen), SIZE, model="equisolid")
    assert str(found.verdict) == "usable"
    (said,) = [reason for reason in found.verdict.reasons if "around the axis empty" in reason]
    assert "put the board" in said
    assert "left" in said
    assert "right" not in said.replace("upper right", "").replace("lower right", "")


def test_corners_in_the_middle_only_name_the_rim():
    truth = lens(180)
    views = Observations.of(observe_boards(truth, 90, np.random.default_rng(0), count=16))
    found = calibrate_camera(views, SIZE, model="equisolid")
    (said,) = [reason for reason in found.verdict.reasons if "of what the image shows" in reason]
    assert "degrees from the axis all around" in said


def test_coverage_counts_what_is_shown():
    _, found = calibrate_lens(180, 0, 16)
    coverage = Coverage.of(found.camera, found.state, found.views)
    assert coverage.corners[1:].sum() + coverage.corners[0, 0] == 16 * BOARD.size
    assert coverage.share > 0.6
    assert coverage.gap == 0.0
    right = found.views.subset([i for i, g in enumerate(found.views.groups) if found.views.pixels[g, 0].min() > 500])
    state = resect(found.camera.model, right)
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
    found = calibrate_camera(Observations.of(views), SIZE, model="radial_tangential")
    (tilt,) = [check for check in found.verdict.checks if check.name == "tilt"]
    assert str(tilt.level) == "usable"
    assert "tilt only 14 degrees" in tilt.sentence or "tilt only 15 degrees" in tilt.sentence


@pytest.mark.parametrize("model", ["kannala_brandt", "unified"])
def test_three_copies_of_a_picture_are_not_used(model):
    view = observe_boards(lens(180), 180, np.random.default_rng(0))[3]
    found = calibrate_camera(Observations.of([view] * 3), SIZE, model=model, force=True)
    assert str(found.verdict) == "do not use"
    assert "1 image leaves" in found.verdict.reasons[0]
    assert "or a model with fewer parameters" in found.verdict.reasons[0]


def test_a_camera_that_stands_still_before_a_board_that_does_has_one_picture():
    exact = observe_boards(lens(180), 180, np.random.default_rng(0), count=2, noise=0.0)
    views = noisy(exact * 6, 0.15)
    found = calibrate_camera(views, SIZE, model="equisolid", force=True, flat=True)
    assert str(found.verdict) == "do not use"
    assert found.verdict.reasons[0].startswith("Images that repeat another one: 10 (view 0 = view 2, ")


def test_a_good_set_with_one_picture_twice_is_good_and_it_is_told():
    exact = observe_boards(lens(180), 180, np.random.default_rng(0), count=14, noise=0.0)
    found = calibrate_camera(noisy([*exact, exact[3]], 0.1), SIZE, model="equisolid", flat=True)
    assert str(found.verdict) == "good"
    assert any("Images that repeat another one: 1 (view 3 = view 14)" in said for said in found.verdict.remarks)


def test_a_model_forced_on_a_lens_it_does_not_describe_is_not_called_good():
    views = noisy(observe_boards(lens(200), 200, np.random.default_rng(0), count=16, noise=0.0), 0.05)
    found = calibrate_camera(views, SIZE, model="equidistant", flat=True)
    assert str(found.verdict) != "good"
    (said,) = [reason for reason in found.verdict.reasons if "that a spline explains" in reason]
    assert "--model auto" in said


def test_pictures_of_another_camera_are_named():
    own = observe_boards(lens(180), 180, np.random.default_rng(0), count=10)
    other = observe_boards(lens(100), 100, np.random.default_rng(1), count=2)
    names = [f"{i}.png" for i in range(10)] + ["a.png", "b.png"]
    found = calibrate_camera(Observations.of([*own, *other], names), SIZE)
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
    found = calibrate_camera(Observations.of(views), SIZE, model="equisolid")
    (tilt,) = [check for check in found.verdict.checks if check.name == "tilt"]
    assert str(tilt.level) == "usable"
    assert "leaves the focal length open" not in tilt.sentence


def test_what_is_not_shown_is_no_gap():
    _, found = calibrate_lens(180, 0, 16)
    coverage = Coverage.of(found.camera, found.state, found.views)
    corners, shown = coverage.corners.copy(), coverage.shown.copy()
    corners[:, 3:6] = 0
    assert dataclasses.replace(coverage, corners=corners).gap > np.pi / 2
    shown[:, 3:6] = False
    assert dataclasses.replace(coverage, corners=corners, shown=shown).gap == 0.0


# -- what the verdict is measured on -----------------------------------------------------------------------------


def test_every_kind_of_pictures_that_people_take_can_be_made_and_comes_out_the_same(monkeypatch, pytestconfig):
    monkeypatch.syspath_prepend(str(pytestconfig.rootpath))
    from benchmarks.verdict_scenes import KINDS, Case, scene

    for kind in KINDS:
        session, truth, views = scene(Case(kind, 3))
        assert len(views) == session.images * session.repeats
        np.testing.assert_array_equal(scene(Case(kind, 3))[2].pixels, views.pixels)
        bearings, pixels = truth.field()
        assert np.isfinite(pixels).all()
        assert len(bearings) > 100


def test_a_moving_viewpoint_is_found_in_the_pictures_and_named_with_what_to_take(monkeypatch, pytestconfig):
    monkeypatch.syspath_prepend(str(pytestconfig.rootpath))
    from benchmarks.verdict import run
    from benchmarks.verdict_scenes import Case

    found = run(Case("viewpoint moves", 2))
    assert found.cone.rms > 0.5
    assert str(found.level) == "usable"
    assert "viewpoint" in found.failed
    assert not any("--model spline" in reason for reason in found.reasons)
    (said,) = [reason for reason in found.reasons if "do not meet in a point" in reason and "lands" in reason]
    assert said.endswith("use --model axial.")


def test_a_spline_that_ends_near_the_last_corner_does_not_fold_there():
    found = calibrate_lens(180, model="spline")[1]
    model = found.camera.model
    assert model.theta_max < 1.1 * found.camera.theta_max
    assert model.fold_angle > 1.5 * found.camera.theta_max
    assert not [check for check in found.verdict.checks if check.name == "rim" and check.level]
