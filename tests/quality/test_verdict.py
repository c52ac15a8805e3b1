"""The verdict: its level and its reasons for good and for insufficient images."""

import dataclasses
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from calibrating import SIZE, calibrate, observe
from lenses import BOARD, calibrate_lens, lens, observe_boards
from omnisight.calibration.resection import resect
from omnisight.geometry import rotation as so3
from omnisight.geometry.sphere import polar
from omnisight.quality.coverage import Coverage


def with_noise(exact, noise):
    """Return observations of exact corners with noise (px)."""
    rng = np.random.default_rng(0)
    return observe([(x, p + rng.normal(0, noise, p.shape)) for x, p in exact])


def test_good_images_are_good():
    _, calibration = calibrate_lens(180, 0, 16, noise=0.1)
    assert str(calibration.verdict) == "good"
    assert calibration.reasons == ()
    assert calibration.camera.calibration["verdict"] == "good"


def test_corners_on_one_side_only_are_usable_and_the_empty_side_is_named():
    truth = lens(180)
    views = observe_boards(truth, 180, np.random.default_rng(0), count=40)
    right = [(x, p) for x, p in views if p[:, 0].min() > SIZE[0] / 2 + 20]
    assert len(right) >= 6
    calibration = calibrate(observe(right), model="equisolid")
    assert str(calibration.verdict) == "usable"
    (reason,) = [reason for reason in calibration.reasons if "No corners in a sector" in reason]
    assert "put the board at the " in reason
    assert "left" in reason
    assert "right" not in reason.replace("upper right", "").replace("lower right", "")


def test_corners_in_the_middle_only_are_usable_and_the_border_is_named():
    truth = lens(180)
    views = observe(observe_boards(truth, 90, np.random.default_rng(0), count=16))
    calibration = calibrate(views, model="equisolid")
    (reason,) = [reason for reason in calibration.reasons if "of the visible field of view" in reason]
    assert "° off-axis all around" in reason


def test_coverage_counts_corners_per_cell():
    _, calibration = calibrate_lens(180, 0, 16)
    coverage = Coverage.of(calibration.camera, calibration.state, calibration.observations)
    assert coverage.corners[1:].sum() + coverage.corners[0, 0] == 16 * BOARD.size
    assert coverage.share > 0.6
    assert coverage.gap == 0.0
    pixels, groups = calibration.observations.pixels, calibration.observations.groups
    right = calibration.observations.subset([i for i, group in enumerate(groups) if pixels[group, 0].min() > 500])
    one_side = Coverage.of(calibration.camera, resect(calibration.camera.model, right), right)
    assert one_side.gap >= np.pi / 2
    assert one_side.share < coverage.share


def test_slightly_tilted_boards_are_usable_and_the_reason_states_their_tilt():
    truth = lens(60)
    middle = BOARD.points.mean(0)
    rng = np.random.default_rng(0)
    views = []
    for i, (x, y, distance) in enumerate(((0, 0, 14), (3, 1, 16), (-3, 2, 18), (1, -3, 15), (-2, -2, 17), (2, 2, 13))):
        rotation = so3.exp([np.radians(7.0) * (-1) ** i, 0.0, x / 3])
        pixels, _ = truth.project((BOARD.points - middle) @ rotation.T + [x, y, distance])
        views.append((BOARD.points, pixels + rng.normal(0, 0.05, pixels.shape)))
    calibration = calibrate(observe(views), model="radial_tangential")
    (tilt,) = [check for check in calibration.verdict.checks if check.name == "board tilt"]
    assert str(tilt.level) == "usable"
    assert "tilted by only 14°" in tilt.sentence or "tilted by only 15°" in tilt.sentence


@pytest.mark.parametrize("model", ["kannala_brandt", "unified"])
def test_three_copies_of_an_image_are_not_to_be_used(model):
    view = observe_boards(lens(180), 180, np.random.default_rng(0))[3]
    calibration = calibrate(observe([view] * 3), model=model, force=True)
    assert str(calibration.verdict) == "do not use"
    assert "1 distinct image does not determine all parameters" in calibration.reasons[0]
    # Every model that is advised has been tried.
    assert "--model" not in " ".join(calibration.reasons)


def test_static_camera_and_board_count_as_one_image():
    exact = observe_boards(lens(180), 180, np.random.default_rng(0), count=2, noise=0.0)
    views = with_noise(exact * 6, 0.15)
    calibration = calibrate(views, model="equisolid", force=True, flat=True)
    assert str(calibration.verdict) == "do not use"
    assert calibration.reasons[0].startswith("10 images repeat another one (view 0 = view 2, ")


@pytest.mark.parametrize(("poses", "verdict"), [(1, "do not use"), (4, "usable")])
def test_nearly_identical_images_count_as_one(poses, verdict):
    truth, rng = lens(180), np.random.default_rng(0)
    middle = BOARD.points.mean(0)
    views = []
    for k in range(15):
        base = so3.exp([0.6, 0.3, 0.0]) if k % poses == 0 else so3.exp([-0.5, 0.5 * (k % poses) - 0.8, 0.0])
        rotation = so3.exp(np.radians(1.0) * rng.normal(size=3)) @ base
        translation = rng.normal((2.0 * (k % poses), 0.5, 7.0), 0.1)
        pixels, _ = truth.project((BOARD.points - middle) @ rotation.T + translation)
        views.append((BOARD.points, pixels + rng.normal(0, 0.1, pixels.shape)))
    calibration = calibrate(observe(views))
    assert str(calibration.verdict) == verdict
    assert any("show nearly the same board pose" in reason for reason in calibration.reasons)


def test_one_repeated_image_among_many_is_good_with_a_remark():
    exact = observe_boards(lens(180), 180, np.random.default_rng(0), count=14, noise=0.0)
    calibration = calibrate(with_noise([*exact, exact[3]], 0.1), model="equisolid", flat=True)
    assert str(calibration.verdict) == "good"
    assert any("1 image repeats another one (view 3 = view 14)" in remark for remark in calibration.verdict.remarks)


def test_requested_model_that_does_not_describe_the_lens_is_not_good():
    views = with_noise(observe_boards(lens(200), 200, np.random.default_rng(0), count=16, noise=0.0), 0.05)
    calibration = calibrate(views, model="equidistant", flat=True)
    assert str(calibration.verdict) != "good"
    (reason,) = [reason for reason in calibration.reasons if "The model error of equidistant is" in reason]
    baseline = calibration.quality.spline_baseline
    gain = f"{baseline.model_held_out_rms:.2f} -> {baseline.candidate.held_out_rms:.2f} px"
    assert f"use --model spline (tried: held-out error {gain})" in reason


def test_images_of_another_camera_are_named():
    own = observe_boards(lens(180), 180, np.random.default_rng(0), count=10)
    other = observe_boards(lens(100), 100, np.random.default_rng(1), count=2)
    names = [f"{i}.png" for i in range(10)] + ["a.png", "b.png"]
    calibration = calibrate(observe([*own, *other], names=names))
    (reason,) = [reason for reason in calibration.reasons if "outliers of the common camera" in reason]
    assert "a.png" in reason
    assert "b.png" in reason
    assert "0.png" not in reason
    assert "--drop" in reason


def test_parallel_boards_tilted_against_the_axis_of_a_wide_lens_are_usable():
    truth = lens(180)
    middle = BOARD.points.mean(0)
    rng = np.random.default_rng(0)
    rotation = so3.exp([0.7, 0.2, 0.0])
    views = []
    for i in range(15):
        theta, phi = 1.1 * np.sqrt((i + 0.5) / 15), 2.4 * i
        position = rng.uniform(8, 12) * polar(np.array(theta), np.array(phi))
        pixels, valid = truth.project((BOARD.points - middle) @ rotation.T + position)
        assert valid.all()
        views.append((BOARD.points, pixels + rng.normal(0, 0.05, pixels.shape)))
    calibration = calibrate(observe(views), model="equisolid")
    (tilt,) = [check for check in calibration.verdict.checks if check.name == "board tilt"]
    assert str(tilt.level) == "usable"
    assert "only the distortion of the lens determines the focal length" in tilt.sentence


def test_invisible_cells_are_no_gap():
    _, calibration = calibrate_lens(180, 0, 16)
    coverage = Coverage.of(calibration.camera, calibration.state, calibration.observations)
    corners, visible = coverage.corners.copy(), coverage.visible.copy()
    corners[:, 3:6] = 0
    assert dataclasses.replace(coverage, corners=corners).gap > np.pi / 2
    visible[:, 3:6] = False
    assert dataclasses.replace(coverage, corners=corners, visible=visible).gap == 0.0


def test_scenes_of_the_verdict_benchmark_are_complete_and_deterministic(monkeypatch, pytestconfig):
    monkeypatch.syspath_prepend(str(pytestconfig.rootpath))
    from benchmarks.verdict_scenes import KINDS, Case, scene

    assert len(KINDS) > 10
    for kind in KINDS:
        session, truth, views = scene(Case(kind, 3))
        assert len(views) == session.images * session.repeats
        np.testing.assert_array_equal(scene(Case(kind, 3))[2].pixels, views.pixels)
        bearings, pixels = truth.field()
        assert np.isfinite(pixels).all()
        assert len(bearings) > 100


def test_noncentral_camera_is_usable_and_the_reason_names_the_axial_model(monkeypatch, pytestconfig):
    monkeypatch.syspath_prepend(str(pytestconfig.rootpath))
    from benchmarks.verdict import run
    from benchmarks.verdict_scenes import Case

    result = run(Case("viewpoint moves", 2))
    assert result.cone.rms > 0.5
    assert str(result.level) == "usable"
    assert "central camera" in result.failed
    assert not any("--model spline" in reason for reason in result.reasons)
    (reason,) = [reason for reason in result.reasons if "Non-central camera: a central model is" in reason]
    assert "use --model axial (tried: held-out error " in reason


def test_spline_is_injective_beyond_the_outermost_corner():
    calibration = calibrate_lens(180, model="spline")[1]
    model = calibration.camera.model
    assert model.theta_max < 1.1 * calibration.camera.theta_max
    assert model.fold_angle > 1.5 * calibration.camera.theta_max
    (check,) = [check for check in calibration.verdict.checks if check.name == "injectivity"]
    assert not check.level


CHECK = """
from omnisight.quality.evidence import Check, Level

PRIORITY = -1

def check(evidence):
    return Check("view count", Level.DO_NOT_USE, f"There are {len(evidence.observations)} views.")
"""


def test_check_added_as_a_file_takes_part_in_the_verdict(tmp_path):
    (tmp_path / "view_count.py").write_text(CHECK)
    script = (
        "import omnisight.quality.checks as checks\n"
        f"checks.__path__.append({str(tmp_path)!r})\n"
        "from lenses import calibrate_first_views\n"
        "calibration = calibrate_first_views(4, model='equisolid', flat=True)\n"
        "assert str(calibration.verdict) == 'do not use'\n"
        "assert calibration.reasons[0] == 'There are 4 views.', calibration.reasons\n"
        "assert calibration.camera.calibration['reasons'][0] == 'There are 4 views.'\n"
    )
    # A new process, because the checks are listed once per process.
    tests = Path(__file__).resolve().parents[1]
    done = subprocess.run([sys.executable, "-c", script], cwd=tests, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_camera_without_visible_cells_outside_the_middle_has_no_gap():
    corners, visible = np.zeros((2, 8), np.intp), np.zeros((2, 8), bool)
    corners[:, :], visible[0] = 9, True
    coverage = Coverage(np.radians([0.0, 10.0, 20.0]), corners, visible)
    assert coverage.gap == 0.0
    everywhere = Coverage(coverage.edges, np.zeros((2, 8), np.intp), np.ones((2, 8), bool))
    assert everywhere.gap == pytest.approx(2 * np.pi)
    assert everywhere.empty_side().count(",") == 6
