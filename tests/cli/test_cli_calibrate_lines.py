"""omnisight calibrate-lines."""

import json
import re

import numpy as np
import pytest
from cli_scene import file_names

from omnisight.formats import load
from omnisight.images import read_image, write_image
from omnisight.models.unified import Unified
from omnisight.simulation import mirror_setup

TRUTH = Unified(300.0, 300.0, 652.0, 498.0, 1.0)


@pytest.fixture(scope="session")
def room(tmp_path_factory):
    path = tmp_path_factory.mktemp("room") / "room.png"
    write_image(path, mirror_setup(480).renderer(samples=2)().image)
    return path


@pytest.fixture
def drawn(tmp_path):
    """Write a blank image and a file of ten lines seen in a parabolic mirror."""
    rng = np.random.default_rng(0)
    lines = []
    while len(lines) < 10:
        across = np.linalg.svd(rng.normal(size=(1, 3)))[2][1:]
        turn = np.linspace(0, 1.4, 20)[:, None] + rng.uniform(0, 6)
        pixels, valid = TRUTH.project_numpy(np.cos(turn) * across[0] + np.sin(turn) * across[1])
        if valid.all() and np.linalg.norm(pixels - (652, 498), axis=1).max() < 480:
            lines.append((pixels + 0.3 * rng.normal(size=pixels.shape)).tolist())
    write_image(tmp_path / "blank.png", np.full((1024, 1280), 90, np.uint8))
    (tmp_path / "lines.json").write_text(json.dumps(lines))
    return tmp_path


def test_one_image_of_a_room_calibrates_a_mirror(run, room, tmp_path):
    status, out, err = run("calibrate-lines", room, "-o", tmp_path / "camera.json", "--draw", tmp_path / "drawn")
    assert (status, err) == (0, "")
    assert out.startswith("parameter ")
    assert re.search(r"^camera +unified, 480x360, lines up to \d+° off-axis, \d+ lines,", out, re.MULTILINE)
    assert re.search(r"^accuracy +rms 0\.\d+ px; bearings [\d.]+° \(1σ\)$", out, re.MULTILINE)
    assert "unknown   handedness" in out
    assert f"written   {tmp_path / 'camera.json'}" in out
    camera = load(tmp_path / "camera.json")
    assert camera.size == (480, 360)
    assert camera.calibration["method"] == "lines"
    assert camera.calibration["lines"] > 20
    assert camera.covariance.shape == (6, 6)
    deviation = np.sqrt(np.diagonal(camera.covariance))
    assert (deviation[:5] > 0).all()
    assert deviation[5] == 0
    assert 1.0 < camera.theta_max < np.radians(112)
    assert camera.provenance["images"] == ["room.png"]
    assert camera.model.to_dict()["xi"] == pytest.approx(0.97, abs=max(4 * deviation[4], 0.02))
    assert file_names(tmp_path / "drawn") == ["room.png"]
    sheet = read_image(tmp_path / "drawn" / "room.png").astype(int)
    assert ((sheet[..., 1] > 180) & (sheet[..., 0] < 120)).sum() > 1000


def test_drawn_lines_and_fixed_parameters_are_used(run, drawn):
    camera = drawn / "c.json"
    given = ("--lines", drawn / "lines.json", "--fix", "xi=1")
    status, out, err = run("calibrate-lines", drawn / "blank.png", *given, "--json", "-o", camera)
    assert (status, err) == (0, "")
    result = json.loads(out)
    assert result["lines"] == result["arcs"] == 10
    assert result["camera"]["params"]["xi"] == 1
    assert result["deviations"]["xi"] == 0
    off = load(camera).model.params - TRUTH.params
    assert np.abs(off).max() < 2
    assert np.abs(off[0]) < 4 * result["deviations"]["fx"]
    assert 0 < result["bearing_sd_deg"] < 0.5
    assert load(camera).provenance["lines"] == "lines.json"


def test_images_of_one_name_in_two_folders_are_named_with_their_folders(run, refuses, drawn):
    images = [drawn / folder / "blank.png" for folder in "ab"]
    for image in images:
        image.parent.mkdir()
        write_image(image, np.full((1024, 1280), 90, np.uint8))
    lines = json.loads((drawn / "lines.json").read_text())
    (drawn / "same.json").write_text(json.dumps({"blank.png": lines}))
    message = refuses("calibrate-lines", *images, "--lines", drawn / "same.json", "-o", drawn / "c.json")
    assert "names blank.png, which several images are named: use a/blank.png, b/blank.png" in message
    (drawn / "two.json").write_text(json.dumps({"a/blank.png": lines[:4], "b/blank.png": lines[4:]}))
    output = drawn / "c.json"
    assert run("calibrate-lines", *images, "--lines", drawn / "two.json", "--fix", "xi=1", "-o", output)[0] == 0
    assert load(output).provenance["images"] == ["a/blank.png", "b/blank.png"]


def test_invalid_input_is_rejected_in_one_line(refuses, drawn):
    blank, lines = drawn / "blank.png", drawn / "lines.json"
    assert "0 lines are too few" in refuses("calibrate-lines", blank)
    assert "unified has no k1; it has fx" in refuses("calibrate-lines", blank, "--fix", "k1=0")
    assert "such as xi=1, got 'xi'" in refuses("calibrate-lines", blank, "--fix", "xi")
    assert "--fix xi=nan: xi of unified must be finite and at least" in refuses(
        "calibrate-lines", blank, "--fix", "xi=nan"
    )
    assert "--fix fx=-inf: fx of unified must be finite" in refuses("calibrate-lines", blank, "--fix", "fx=-inf")
    assert "there is no folder" in refuses("calibrate-lines", blank, "-o", drawn / "none" / "c.json")
    assert "unknown camera model" in refuses("calibrate-lines", blank, "--model", "nonsense")
    (drawn / "bad.json").write_text('{"other.png": []}')
    assert "names other.png, which is not one of the images" in refuses(
        "calibrate-lines", blank, "--lines", drawn / "bad.json"
    )
    write_image(drawn / "mask.png", np.zeros((5, 5), np.uint8))
    assert "mask.png: is 5 x 5 px, and must have the size of the image or view that it masks, 1280 x 1024" in refuses(
        "calibrate-lines", blank, "--mask", drawn / "mask.png"
    )
    assert "specify one of them" in refuses(
        "calibrate-lines", blank, "--mask", drawn / "mask.png", "--lines", lines, "-o", drawn / "c.json"
    )
    write_image(drawn / "small.png", np.zeros((50, 50), np.uint8))
    assert "images of one camera have one size" in refuses(
        "calibrate-lines", blank, drawn / "small.png", "--lines", lines
    )
