"""omnisight calibrate with corner files."""

import json

import numpy as np
import pytest
from cli_scene import SIZE, TRUTH, project_boards

from omnisight.formats import load
from omnisight.images import read_image, write_image


@pytest.fixture
def corners(tmp_path):
    np.savez(tmp_path / "shots.npz", corners=project_boards(8), pattern=(9, 6), image_size=SIZE)
    return tmp_path / "shots.npz"


QUICK = ("--model", "equidistant")


def test_corner_file_is_calibrated_like_images(run, corners, tmp_path):
    outputs = ("-o", tmp_path / "camera.json", "--draw", tmp_path / "drawn", "--report", tmp_path / "report.html")
    status, out, err = run("calibrate", corners, "--square", "30mm", *QUICK, *outputs)
    assert (status, err) == (0, "")
    lines = out.splitlines()
    assert [line.split()[0] for line in lines[1:9]] == [f"shots-{k}" for k in range(1, 9)]
    assert "8 of 8 images, 432 corners" in out
    drawn = f"drawn     {tmp_path / 'drawn'} (8 images on a blank background: their files are missing)"
    assert drawn in lines
    assert lines[-1] == f"report    {tmp_path / 'report.html'}"
    camera = load(tmp_path / "camera.json")
    assert camera.size == SIZE
    assert camera.provenance["target"] == {"target": "points", "points": 54, "flat": True}
    np.testing.assert_allclose(camera.model.params, TRUTH.model.params, rtol=0.01)
    assert len(list((tmp_path / "drawn").iterdir())) == 8
    assert read_image(tmp_path / "drawn" / "shots-1.png").std() > 5
    assert "shots-8" in (tmp_path / "report.html").read_text()


def test_json_and_drop_use_image_names(run, corners):
    status, out, _ = run("calibrate", corners, *QUICK, "--json", "--drop", "shots-2")
    assert status == 0
    result = json.loads(out)
    assert [row["name"] for row in result["images"]] == [f"shots-{k}" for k in (1, 3, 4, 5, 6, 7, 8)]
    assert result["pattern"] == "54 points"


def test_residuals_are_drawn_on_the_images_next_to_the_corner_file(run, tmp_path):
    for k in range(4):
        write_image(tmp_path / f"{k}.png", np.full(SIZE[::-1], 200, np.uint8))
    np.savez(tmp_path / "v.npz", corners=project_boards(4), pattern=(9, 6), files=[f"{k}.png" for k in range(4)])
    status, out, _ = run("calibrate", tmp_path / "v.npz", *QUICK, "--draw", tmp_path / "drawn")
    assert status == 0
    assert out.splitlines()[-1] == f"drawn     {tmp_path / 'drawn'}"
    assert read_image(tmp_path / "drawn" / "0.png").mean() > 150


def test_detect_json_can_be_calibrated(run, shots, tmp_path):
    status, out, _ = run("detect", shots, "--pattern", "9x6", "--json")
    assert status == 0
    (tmp_path / "corners.json").write_text(out)
    status, calibrated, err = run("calibrate", tmp_path / "corners.json", *QUICK, "--json")
    assert (status, err) == (0, "")
    expected = json.loads(run("calibrate", shots, "--pattern", "9x6", *QUICK, "--json")[1])
    assert [row["name"] for row in json.loads(calibrated)["images"]] == [row["name"] for row in expected["images"]]
    assert json.loads(calibrated)["rms"] == pytest.approx(expected["rms"], abs=0.1)


def test_corner_files_have_no_redetection_pass(run, corners):
    _, out, _ = run("calibrate", corners, *QUICK, "--json")
    assert set(json.loads(out)["redetection"].values()) == {0}


@pytest.mark.parametrize(
    ("case", "message"),
    [
        ("few views", "2 of 2 images have enough corners; at least 3 are needed, 10 to 20 are good"),
        ("no size", "specify --image-size, such as 1280x800 (corners reach"),
        ("an invalid size", "--image-size must be WIDTHxHEIGHT in px, such as 1280x720, got 'big'"),
        ("a size with images", "--image-size is for corner files; images contain their size: leave it out"),
        ("a camera with images", "--which is for corner files of several cameras"),
        (
            "text",
            "notes.txt: neither an image nor a corner file of a known format (begins with 'Call Bob')",
        ),
        ("its own output", "is one of the inputs and would be overwritten"),
    ],
)
def test_invalid_input_is_rejected(case, message, refuses, corners, shots, tmp_path):
    command = [corners, *QUICK]
    match case:
        case "few views":
            np.savez(corners, corners=project_boards(2), pattern=(9, 6), image_size=SIZE)
        case "no size" | "an invalid size":
            np.savez(corners, corners=project_boards(4), pattern=(9, 6))
            command += [] if case == "no size" else ["--image-size", "big"]
        case "a size with images":
            command = [shots, "--image-size", "640x480"]
        case "a camera with images":
            command = [shots, "--which", "left"]
        case "text":
            (tmp_path / "notes.txt").write_text("Call Bob")
            command = [tmp_path / "notes.txt"]
        case _:
            command += ["-o", corners]
    assert message in refuses("calibrate", *command)


def test_image_size_option(run, corners):
    np.savez(corners, corners=project_boards(4), pattern=(9, 6))
    status, out, _ = run("calibrate", corners, *QUICK, "--image-size", f"{SIZE[0]}x{SIZE[1]}", "--json")
    assert status == 0
    assert json.loads(out)["camera"]["size"] == list(SIZE)
