"""omnisight detect, and boards from target files."""

import json

import cv2
import numpy as np
import pytest
from cli_scene import BOARD, file_names, raises_error

from drawn import POSES, SIZE, pose, project
from omnisight.formats import load
from omnisight.images import read_image, write_image
from prints import CAMERAS, CHARUCO
from prints import pose as hold
from prints import render as draw


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path / "here"


@pytest.fixture(scope="module")
def charucos(tmp_path_factory):
    """Six images of a board of markers through a fisheye."""
    folder = tmp_path_factory.mktemp("charucos")
    views = ((0, 0, 0.2), (30, 70, 0.16), (45, 180, 0.14), (40, 300, 0.17), (50, 0, 0.15), (20, 220, 0.12))
    for i, (angle, azimuth, distance) in enumerate(views):
        placed = hold(CHARUCO, angle, azimuth=azimuth, distance=distance, roll=40 * i)
        write_image(folder / f"{i}.png", draw(CHARUCO, "fisheye", placed, seed=i)[0])
    return folder


def line_of(out, name):
    (line,) = (line for line in out.splitlines() if line.split()[:1] == [name])
    return line


def test_detect_prints_a_row_per_image_and_the_result(run, shots):
    status, out, err = run("detect", shots, "--pattern", "9x6")
    assert (status, err) == (0, "")
    for i in range(1, 7):
        assert line_of(out, f"{i}.png").split()[1] == "1"
        assert int(line_of(out, f"{i}.png").split()[2]) > 50
    assert "detected  9x6 in 6 of 6 images, " in out
    assert "corners\n" in out
    assert out.rstrip().endswith("drawn     omnisight-detect")


def test_an_unwritable_folder_is_refused_before_the_detection(refuses, shots, tmp_path, monkeypatch):
    monkeypatch.setattr("omnisight.pipeline.detection.detect.detect", raises_error(AssertionError("images were read")))
    (tmp_path / "file").touch()
    folder = tmp_path / "file" / "drawn"
    assert f"{tmp_path / 'file'}: is a file; choose a folder" in refuses("detect", shots, "-o", folder)


def test_pattern_is_determined_without_the_option(run, shots):
    specified, determined = (
        json.loads(run("detect", shots, "--json", *more)[1]) for more in (("--pattern", "9x6"), ())
    )
    assert determined == specified


def test_wrong_pattern_gives_a_hint_with_the_right_one(run, shots):
    status, out, _ = run("detect", shots, "--pattern", "10x7")
    assert status == 0
    assert "detected  10x7 in 0 of 6 images, 0 corners" in out
    assert "Use --pattern 9x6 or --squares 10x7." in out
    assert "no 10x7 board detected, but one of 9x6" in line_of(out, "3.png")


@pytest.mark.parametrize("output", [None, "drawn/here"])
def test_detections_are_drawn_on_enlarged_images(run, shots, elsewhere, output):
    status, out, _ = run("detect", shots / "1.png", shots / "2.png", *(() if output is None else ("-o", output)))
    assert status == 0
    folder = elsewhere / (output or "omnisight-detect")
    assert f"drawn     {output or 'omnisight-detect'}" in out
    assert file_names(folder) == ["1.png", "2.png"]
    for name in file_names(folder):
        drawn, given = read_image(folder / name), read_image(shots / name)
        assert drawn.shape[1] >= 2 * SIZE[0]
        assert drawn.shape[2] == 3
        assert drawn.shape[1] / drawn.shape[0] == pytest.approx(given.shape[1] / given.shape[0])
        plain = cv2.resize(given, drawn.shape[1::-1], interpolation=cv2.INTER_CUBIC)[..., None]
        coloured = np.abs(drawn.astype(int) - plain).max(axis=2) > 60
        assert 0.003 < coloured.mean() < 0.3
        assert np.ptp(drawn.astype(int), axis=2).max() > 100


def test_small_images_are_drawn_at_least_1600_px_wide(run, shots, elsewhere):
    assert run("detect", shots / "1.png")[0] == 0
    assert read_image(elsewhere / "omnisight-detect" / "1.png").shape[1] >= 1600


def test_large_image_is_drawn_at_its_size(run, shots, tmp_path, elsewhere):
    wide = cv2.resize(read_image(shots / "1.png"), (1600, 1200), interpolation=cv2.INTER_CUBIC)
    write_image(tmp_path / "wide.png", wide)
    assert run("detect", tmp_path / "wide.png")[0] == 0
    drawn = read_image(elsewhere / "omnisight-detect" / "wide.png")
    assert drawn.shape == (1200, 1600, 3)
    assert (np.abs(drawn.astype(int) - wide[..., None]).max(axis=2) > 60).any()


def test_json_prints_one_object_and_draws_nothing(run, shots, elsewhere):
    status, out, err = run("detect", shots, "--json")
    assert (status, err) == (0, "")
    message = json.loads(out)
    assert file_names(elsewhere) == []
    assert message["pattern"] == "9x6"
    assert message["target"] == {"target": "checkerboard", "columns": 9, "rows": 6} | message["target"]
    assert message["hint"] is None
    assert [p["name"] for p in message["images"]] == [f"{i}.png" for i in range(1, 7)]
    for i, image in enumerate(message["images"]):
        assert image["size"] == list(SIZE)
        assert image["sharpness"] > 0
        assert isinstance(image["note"], str)
        (board,) = image["boards"]
        assert board["pattern"] == "9x6"
        assert board["located"] is True
        count = len(board["ids"])
        assert np.shape(board["pixels"]) == (count, 2)
        assert np.shape(board["covariance"]) == (count, 2, 2)
        rotation, position = pose(BOARD, *POSES[i])
        truth = project(BOARD.points @ rotation.T + position)
        assert np.abs(np.array(board["pixels"]) - truth[board["ids"]]).max() < 0.35


def test_json_draws_with_output(run, shots, elsewhere):
    status, out, _ = run("detect", shots / "1.png", "--json", "--output", "drawn")
    assert status == 0
    assert json.loads(out)["pattern"] == "9x6"
    assert file_names(elsewhere / "drawn") == ["1.png"]


def test_unreadable_images_are_listed_with_the_reason(run, folder, elsewhere):
    (folder / "2.png").write_text("I am no image")
    (folder / "3.png").write_bytes(b"")
    status, out, _ = run("detect", folder, "--pattern", "9x6")
    assert status == 0
    assert "not an image" in line_of(out, "2.png")
    assert "empty file" in line_of(out, "3.png")
    assert "detected  9x6 in 4 of 6 images" in out
    assert file_names(elsewhere / "omnisight-detect") == ["1.png", "4.png", "5.png", "6.png"]
    message = json.loads(run("detect", folder, "--json")[1])
    bad = message["images"][1]
    assert (bad["size"], bad["boards"], bad["sharpness"], bad["exposure"]) == (None, [], None, None)


def test_images_without_a_board_are_no_error(run, tmp_path):
    for i in range(2):
        write_image(tmp_path / f"{i}.png", np.full((480, 640), 90 + 90 * i, np.uint8))
    status, out, _ = run("detect", tmp_path)
    assert status == 0
    assert "no board; specify --pattern or --target" in out
    assert line_of(out, "0.png").split()[1] == "-"
    status, out, _ = run("detect", tmp_path, "--pattern", "9x6")
    assert status == 0
    assert "detected  9x6 in 0 of 2 images, 0 corners" in out
    message = json.loads(run("detect", tmp_path, "--json")[1])
    assert message["pattern"] is None
    assert [p["boards"] for p in message["images"]] == [[], []]


def test_only_unreadable_images_are_an_error_with_the_reason(refuses, tmp_path):
    (tmp_path / "a.png").write_text("no")
    message = refuses("detect", tmp_path / "a.png")
    assert "none of the images can be read" in message
    assert "a.png: not an image" in message


def test_partial_board_is_noted(run, shots, tmp_path):
    image = read_image(shots / "1.png")
    write_image(tmp_path / "part.png", image[:, :330])
    _, out, _ = run("detect", tmp_path / "part.png", "--pattern", "9x6")
    assert "of 54 corners" in line_of(out, "part.png")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--pattern", "9"), "cannot read the pattern '9'"),
        (("--pattern", "2x9"), "3x3 inner corners or more"),
        (("--square", "30"), "has no unit: write 30mm"),
        (("--target", "none.json"), "none.json"),
        (("--target", "none.json", "--pattern", "9x6"), "specify either --target or --pattern and --square"),
    ],
)
def test_invalid_option_is_an_error(refuses, shots, elsewhere, options, message):
    assert message in refuses("detect", shots, *options)
    assert file_names(elsewhere) == []


def test_images_and_known_options_are_required(run, refuses, shots, tmp_path):
    (tmp_path / "empty").mkdir()
    refuses("detect", tmp_path / "empty")
    assert run("detect")[0] == 2
    assert run("detect", shots, "--colour")[0] == 2
    message = refuses("detect", shots, "-o", shots)
    assert "is one of the inputs and would be overwritten" in message


def test_target_file_that_was_made_is_used_by_detect_and_calibrate(run, refuses, shots, elsewhere):
    assert run("target", "checkerboard", "9x6", "--square", "24mm", "-o", "board.pdf")[0] == 0
    message = json.loads(run("detect", shots, "--target", "board.json", "--json")[1])
    assert message["target"]["square"] == "24mm"
    assert [len(p["boards"]) for p in message["images"]] == [1] * 6
    status, out, _ = run(
        "calibrate", shots, "--target", "board.json", "--model", "equidistant", "-o", "camera.json", "--json"
    )
    assert status == 0
    assert json.loads(out)["rms"] < 0.1
    camera = load(elsewhere / "camera.json")
    assert camera.provenance["target"]["square"] == "24mm"
    assert camera.model.params[0] == pytest.approx(190, rel=2e-3)
    assert "specify either --target or" in refuses("calibrate", shots, "--target", "board.json", "--square", "24mm")


def test_board_with_markers_is_detected_by_its_target_file(run, charucos):
    made = ("charuco", "9x6", "--square", "24mm", "--marker", "18mm", "-o", "charuco.pdf")
    assert run("target", *made)[0] == 0
    status, out, _ = run("detect", charucos, "--target", "charuco.json")
    assert status == 0
    assert "detected  charuco 9x6 in 6 of 6 images" in out
    assert "no checkerboard" not in out
    status, out, _ = run("detect", charucos, "--target", "charuco.json", "--json")
    message = json.loads(out)
    assert (message["pattern"], message["target"]["target"]) == ("9x6", "charuco")
    assert [p["boards"][0]["located"] for p in message["images"]] == [True] * 6


def test_images_of_a_board_with_markers_calibrate_a_camera(run, charucos, elsewhere):
    made = ("charuco", "9x6", "--square", "24mm", "--marker", "18mm", "-o", "charuco.pdf")
    assert run("target", *made)[0] == 0
    options = ("--target", "charuco.json", "--model", "equidistant", "-o", "camera.json", "--json")
    status, out, _ = run("calibrate", charucos, *options)
    assert status == 0
    assert json.loads(out)["rms"] < 0.15
    found, truth = load(elsewhere / "camera.json").model, CAMERAS["fisheye"]
    np.testing.assert_allclose(found.params[:2], truth.params[:2], rtol=1e-3)
    np.testing.assert_allclose(found.params[2:4], truth.params[2:4], atol=0.2)
