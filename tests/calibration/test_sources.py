"""What `om.calibrate` accepts as its source, and the errors for wrong sources and observations."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import omnisight as om
from calibrating import SIZE, calibrate, observe
from lenses import BOARD, lens, observe_boards
from omnisight.images import ImageField
from omnisight.images.ellipse import Ellipse
from omnisight.targets import ImageDetection

OPTIONS = {"model": "equisolid", "flat": True}


@pytest.fixture(scope="module")
def views():
    return observe_boards(lens(180), 180, np.random.default_rng(0), count=5)


@pytest.fixture(scope="module")
def from_observations(views):
    return calibrate(observe(views), **OPTIONS)


def same_camera(calibration, other):
    return np.allclose(calibration.camera.model.params, other.camera.model.params, rtol=1e-9, atol=1e-9)


def test_detections_are_accepted(views, from_observations):
    ids = np.arange(BOARD.size)
    images = [
        ImageDetection(Path(f"{i}.png"), SIZE, (om.Detection(ids, pixels, np.zeros((BOARD.size, 2, 2))),))
        for i, (_, pixels) in enumerate(views)
    ]
    calibration = calibrate(om.Detections(BOARD, images), **OPTIONS)
    assert calibration.observations.names == tuple(f"{i}.png" for i in range(len(views)))
    assert same_camera(calibration, from_observations)


def test_list_of_arrays_with_the_image_size_is_accepted(views, from_observations):
    size = f"{SIZE[0]}x{SIZE[1]}"
    calibration = calibrate(list(views), image_size=size, **OPTIONS)
    assert calibration.camera.size == SIZE
    assert same_camera(calibration, from_observations)
    with_covariance = [(points, pixels, np.tile(0.04 * np.eye(2), (len(points), 1, 1))) for points, pixels in views]
    calibration = calibrate(with_covariance, image_size=size, **OPTIONS)
    assert np.allclose(calibration.camera.model.params, from_observations.camera.model.params, rtol=1e-3, atol=1e-2)


def test_length_of_a_square_scales_arrays(views):
    metres = calibrate(list(views), image_size="960x960", square="30mm", **OPTIONS)
    squares = calibrate(list(views), image_size="960x960", **OPTIONS)
    assert (metres.observations.unit, squares.observations.unit) == ("m", "squares")
    np.testing.assert_allclose(metres.state.translations, 0.03 * squares.state.translations, rtol=1e-4)


def test_arrays_without_image_size_are_an_error(views):
    with pytest.raises(ValueError, match=r'arrays do not contain the image size: specify image_size="1280x720"'):
        calibrate(list(views))


def test_covariance_of_some_arrays_only_is_an_error(views):
    points, pixels = views[0]
    mixed = [*views[1:], (points, pixels, np.zeros((len(points), 2, 2)))]
    with pytest.raises(ValueError, match="specify a covariance for every image or for none"):
        calibrate(mixed, image_size="960x960")


@pytest.mark.parametrize("source", [[1, 2, 3], 5, None, {"images": 3}, [np.zeros((3, 2))]])
def test_source_of_another_type_is_an_error_that_lists_the_accepted_ones(source):
    with pytest.raises(ValueError, match=r"source must be a folder, image files, .* Detections or Observations, got"):
        om.calibrate(source)


def test_empty_source_is_an_error():
    with pytest.raises(ValueError, match="source is empty"):
        om.calibrate([])


def test_missing_folder_is_an_error_with_its_name(tmp_path):
    with pytest.raises(FileNotFoundError, match="no_such_folder: no such file or folder"):
        om.calibrate(tmp_path / "no_such_folder")
    with pytest.raises(FileNotFoundError, match="no_such_folder: no such file or folder"):
        om.calibrate(str(tmp_path / "no_such_folder"))


def test_swapped_image_size_is_an_error(views):
    wide = [(points, pixels * (1.5, 0.5)) for points, pixels in views]
    assert observe(wide, (1440, 480)).size == (1440, 480)
    with pytest.raises(ValueError, match=r"480x1440 .* all corners lie inside 1440x480"):
        calibrate(wide, image_size="480x1440")


@pytest.mark.parametrize("text", ["960", "960x", "0x960", "960x960x3", "wide"])
def test_invalid_image_size_is_an_error(views, text):
    with pytest.raises(ValueError, match="--image-size must be WIDTHxHEIGHT in px"):
        calibrate(list(views), image_size=text)


def test_unknown_image_size_is_an_error(views):
    with pytest.raises(ValueError, match="the image size is unknown"):
        calibrate(observe(views, (0, 0)))


def test_dropped_images_are_left_out(views):
    observations = observe(views, names=["a", "b", "c", "d", "e"])
    calibration = calibrate(observations, drop=("b",), **OPTIONS)
    assert calibration.observations.names == ("a", "c", "d", "e")
    with pytest.raises(ValueError, match=r"--drop: there is no image x; there are a, b, c, d, e"):
        calibrate(observations, drop=("x",))
    with pytest.raises(ValueError, match="--drop leaves no image"):
        calibrate(observations, drop=("a", "b", "c", "d", "e"))


def test_observations_of_arrays_have_names_extent_and_unit(views):
    points, pixels = zip(*views, strict=True)
    observations = om.Observations.from_arrays(points, pixels, size=SIZE, unit="m")
    assert len(observations) == len(views)
    assert observations.names == ("view 0", "view 1", "view 2", "view 3", "view 4")
    assert observations.unit == "m"
    np.testing.assert_array_equal(observations.extent, [[0, 0], [BOARD.columns - 1, BOARD.rows - 1]])
    np.testing.assert_array_equal(observations.pixels[observations.groups[2]], pixels[2])
    assert not observations.covariance.any()
    assert observations.is_planar
    assert not observe([(views[0][0] + (0, 0, 1), views[0][1])]).is_planar


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"board_points": "points"}, "board_points must be a list with one array per view, got str"),
        ({"pixels": om.Checkerboard(9, 6)}, "pixels must be a list with one array per view, got Checkerboard"),
        ({"pixels": []}, "needs one array of each per view, got 5 of points and 0 of pixels"),
        ({"covariance": []}, "needs one covariance array per view, got 0 for 5 views"),
        ({"names": ["a"]}, "needs one name per view, got 1 names and 5 views"),
        ({"size": 960}, r"size must be \(width, height\) in px, got 960"),
        ({"size": (-1, 960)}, r"size must be \(width, height\) in px, got \(-1, 960\)"),
        ({"size": (100, 100)}, "is outside the image of 100x100"),
        ({"covariance": [np.zeros((3, 2, 2))] * 5}, r"view 0: needs a covariance \(n, 2, 2\), got \(3, 2, 2\)"),
    ],
)
def test_inconsistent_arrays_are_an_error(views, changes, message):
    points, pixels = zip(*views, strict=True)
    arguments = {"board_points": points, "pixels": pixels, "size": SIZE}
    assert len(om.Observations.from_arrays(**arguments)) == 5
    with pytest.raises(ValueError, match=message):
        om.Observations.from_arrays(**{**arguments, **changes})


def test_field_of_the_observations_reaches_the_uncertainty_map(views, from_observations):
    field = ImageField(SIZE, Ellipse((481.0, 476.0), (300.0, 300.0)))
    calibration = calibrate(replace(observe(views), field=field), **OPTIONS)
    assert calibration.quality.uncertainty.visible.sum() < from_observations.quality.uncertainty.visible.sum()
