"""omnisight evaluate."""

import json
from dataclasses import replace

import numpy as np
import pytest
from cli_scene import BOARD, SIZE, TRUTH, project_boards

from omnisight.formats import format_names, get_format, save
from omnisight.images import write_image


@pytest.fixture
def corners(tmp_path):
    np.savez(tmp_path / "other.npz", corners=project_boards(5, seed=7), pattern=(9, 6), image_size=SIZE)
    return tmp_path / "other.npz"


def test_a_camera_is_evaluated_on_images(run, shots, camera_file):
    status, out, err = run("evaluate", camera_file, shots, "--pattern", "9x6")
    assert (status, err) == (0, "")
    assert "camera    camera.json (equidistant), unchanged; 6 poses estimated" in out
    assert "(Huber threshold 1.5 px, as BabelCalib)" in out
    assert "0° to 10°" in out
    assert out.splitlines()[-1].startswith("residuals 324 corners: rms 0.0")


def test_json_contains_all_statistics(run, corners, camera_file):
    status, out, err = run("evaluate", camera_file, corners, "--json")
    assert (status, err) == (0, "")
    result = json.loads(out)
    assert (result["camera"], result["model"], result["threshold"]) == ("camera.json", "equidistant", 1.5)
    assert [row["name"] for row in result["images"]] == [f"other-{k}" for k in range(1, 6)]
    assert result["all"]["corners"] == 270 == sum(row["corners"] for row in result["images"])
    # The noise of 0.1 px a coordinate, less what the poses take up.
    assert result["all"]["rms"] == pytest.approx(0.1 * np.sqrt(2), rel=0.12)
    assert set(result["all"]) == {"corners", "rms", "mean", "median", "wrms", "worst"}
    assert sum(ring["corners"] for ring in result["rings"]) == 270
    assert result["beyond"]["corners"] == 0
    assert result["calibrated_deg"] == pytest.approx(np.degrees(1.4))
    assert result["compared"] == []
    assert [pose["image"] for pose in result["poses"]] == [row["name"] for row in result["images"]]
    for pose in result["poses"]:
        assert np.allclose(np.array(pose["rotation"]) @ np.transpose(pose["rotation"]), np.eye(3))
        assert np.linalg.eigvalsh(pose["covariance"]).min() > 0


def test_cameras_are_compared_on_the_same_corners(run, corners, camera_file, tmp_path):
    model = TRUTH.model.with_params(TRUTH.model.params * (1.05, 1.05, 1.0, 1.0))
    worse = save(replace(TRUTH, model=model, theta_max=0.5), tmp_path / "worse.json").path
    command = ("evaluate", camera_file, corners, "--compare", worse, "--compare", camera_file)
    status, out, _ = run(*command)
    assert status == 0
    table = {
        line.split()[0]: line.split() for line in out.splitlines() if line.startswith(("camera.json ", "worse.json "))
    }
    result = json.loads(run(*command, "--json")[1])
    assert [one["camera"] for one in result["compared"]] == ["camera.json", "worse.json"]
    ours, other = result["compared"]
    assert ours["common"]["rms"] < 0.2 < other["common"]["rms"]
    assert other["beyond"]["corners"] > 0
    assert table["worse.json"][1:3] == ["270", f"{other['common']['rms']:.3f}"]


def test_corners_beyond_the_calibrated_field_are_reported(run, corners, tmp_path):
    narrow = save(replace(TRUTH, theta_max=0.5), tmp_path / "narrow.json").path
    _, out, _ = run("evaluate", narrow, corners)
    assert "beyond the calibrated field (29°): " in out
    assert "not calibrated" in out
    assert "partly calibrated" in out


@pytest.mark.parametrize("name", [name for name in format_names() if "equidistant" in get_format(name).MODELS])
def test_a_camera_of_another_format_is_evaluated(name, run, corners, tmp_path):
    file = save(TRUTH, tmp_path / f"c{get_format(name).SUFFIX}", format=name).path
    status, out, _ = run("evaluate", file, corners, "--json")
    assert status == 0
    assert json.loads(out)["all"]["rms"] < 0.2


def test_residuals_are_drawn(run, corners, camera_file, tmp_path):
    status, out, _ = run("evaluate", camera_file, corners, "--draw", tmp_path / "drawn")
    assert status == 0
    assert "(5 images on a blank background: their files are missing)" in out
    assert sorted(path.name for path in (tmp_path / "drawn").iterdir()) == [f"other-{k}.png" for k in range(1, 6)]


@pytest.mark.parametrize(
    ("case", "message"),
    [
        (
            "another size",
            "camera.json: for images of 640x480 px, but these are 800x600 px: specify images as the camera",
        ),
        ("no camera", "nowhere.json: no such file or folder"),
        ("no board", "9x6 board detected in none of 1 images: does it have 9x6 inner corners"),
        ("a threshold", "threshold must be a positive length in px, got -1"),
        ("a size", "--image-size is for corner files; images contain their size: leave it out"),
    ],
)
def test_invalid_input_is_rejected(case, message, refuses, corners, shots, camera_file, tmp_path):
    command = [camera_file, corners]
    match case:
        case "another size":
            command += ["--image-size", "800x600"]
        case "no camera":
            command[0] = tmp_path / "nowhere.json"
        case "no board":
            write_image(tmp_path / "black.png", np.zeros(SIZE[::-1], np.uint8))
            command = [camera_file, tmp_path / "black.png", "--pattern", str(BOARD)]
        case "a threshold":
            command += ["--threshold", "-1"]
        case _:
            command = [camera_file, shots, "--image-size", "640x480"]
    assert message in refuses("evaluate", *command)
