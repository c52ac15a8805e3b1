"""The board bend test: recognition of sheets that bend differently in each image."""

import dataclasses

import numpy as np
import pytest

from calibrating import calibrate, observe
from omnisight.calibration.rotation_alignment import rotation_aligned_difference
from omnisight.calibration.state import State
from omnisight.geometry.sphere import cap
from omnisight.models import model_class


@pytest.fixture
def bent_scene(monkeypatch, pytestconfig):
    monkeypatch.syspath_prepend(str(pytestconfig.rootpath))
    from benchmarks.paper_boards import bent_scene

    return bent_scene


def test_a_bent_sheet_keeps_its_lengths(monkeypatch, pytestconfig):
    monkeypatch.syspath_prepend(str(pytestconfig.rootpath))
    from benchmarks.paper_boards import bent

    line = np.linspace(-4, 4, 2001)[:, None] * np.array([0.6, 0.8, 0.0])
    sheet = bent(line, 0.05, np.random.default_rng(0))
    length = np.linalg.norm(np.diff(sheet, axis=0), axis=1).sum()
    assert length == pytest.approx(8.0, rel=1e-6)
    assert np.ptp(sheet[:, 2]) > 0.01


@pytest.mark.parametrize(("camera", "model"), [("kannala_brandt", "kannala_brandt"), ("equisolid", "equisolid")])
def test_sheets_bent_differently_in_each_image_are_recognized(bent_scene, camera, model):
    _, observations = bent_scene(camera, 0, 0.04)
    calibration = calibrate(observations, model=model)
    test = calibration.quality.board_bend
    assert test.is_positive
    assert test.explained > 0.4 > 4 * test.explained_across
    # Heights are uniform between -4 % and 4 %, and a part of each is a change of the pose.
    assert 0.01 < test.height < 0.04
    sentences = (*calibration.reasons, *calibration.verdict.remarks)
    (sentence,) = [sentence for sentence in sentences if "The board bends differently in each image" in sentence]
    assert f"{test.height:.1%} of its width" in sentence
    assert "The bends are estimated" in sentence


def test_estimated_bends_reduce_the_camera_error_to_a_third(bent_scene):
    errors = {False: [], True: []}
    for camera, seed in (("kannala_brandt", 1), ("double_sphere", 0), ("unified", 1)):
        truth, observations = bent_scene(camera, seed, 0.05)
        for flat in errors:
            calibration = calibrate(observations, model=camera, flat=flat)
            assert (calibration.state.bends is None) == flat
            bearings = cap(calibration.camera.theta_max, 12)
            pixels, valid = truth.model.project(bearings)
            inside = valid & calibration.camera.in_image(pixels)
            difference = rotation_aligned_difference(calibration.camera.model, bearings[inside], pixels[inside])
            errors[flat].append((difference**2).sum(1).mean())
            assert flat or errors[flat][-1] < (2 * calibration.quality.uncertainty.rms()) ** 2
    assert np.sqrt(np.mean(errors[False])) < np.sqrt(np.mean(errors[True])) / 3


def test_a_bend_keeps_the_lengths_of_the_sheet():
    """Up to terms of fourth order in the height."""
    line = np.linspace(-1, 1, 201)[:, None] * np.array([0.6, 0.8]) * 3.0
    board = np.concatenate([line, [[0.5, -0.5]]])
    observations = observe([(board, 400 + 100 * board)], extent=[[-3, -3], [3, 3]])
    cylinder = 0.3 * np.array([[0.6**2, 2 * 0.6 * 0.8, 0.8**2]])
    state = State(model_class("pinhole").example(), np.eye(3)[None], np.zeros((1, 3)), bends=cylinder)
    points, _ = state.points(observations)
    assert points[0, 2] == pytest.approx(0.3)
    length = np.linalg.norm(np.diff(points[:-1], axis=0), axis=1).sum()
    assert length == pytest.approx(6.0, rel=2e-4)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_flat_boards_are_not_called_bent(bent_scene, seed):
    _, observations = bent_scene("kannala_brandt", seed, 0.0)
    calibration = calibrate(observations, model="kannala_brandt")
    test = calibration.quality.board_bend
    assert not test.is_positive
    assert test.p_value > 1e-4
    assert not any("bends" in sentence for sentence in (*calibration.reasons, *calibration.verdict.remarks))


def test_a_warp_that_all_images_share_is_not_called_bend(bent_scene):
    _, observations = bent_scene("kannala_brandt", 0, 0.0)
    calibration = calibrate(observations, model="kannala_brandt", flat=True)
    state = dataclasses.replace(calibration.state, warp=np.array([0.3, -0.2]))
    pixels, _ = state.model.project_numpy(state.points(observations)[0])
    noise = np.random.default_rng(0).normal(0, 0.3, pixels.shape)
    warped = dataclasses.replace(observations, pixels=pixels + noise)
    test = calibrate(warped, model="kannala_brandt", flat=True).quality.board_bend
    assert not test.is_positive


def test_model_error_is_not_called_bend(bent_scene):
    _, observations = bent_scene("double_sphere", 0, 0.0)
    calibration = calibrate(observations, model="equidistant")
    assert calibration.rms > 1.0
    assert not any("bends" in sentence for sentence in (*calibration.reasons, *calibration.verdict.remarks))
