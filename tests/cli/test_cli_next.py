"""omnisight next."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from shooting import BOARD, SIZE, TRUTH

from omnisight.formats import save
from omnisight.images import read_image, write_image


@pytest.fixture
def calibrated(tmp_path):
    """Give the file of a camera that knows its board."""
    camera = replace(TRUTH, provenance={"target": {**BOARD.to_dict(), "square": "30mm"}})
    return save(camera, tmp_path / "calibrated.json").path


def test_it_says_where_how_far_and_how_tilted(run, shots, calibrated):
    status, out, err = run("next", shots, "--camera", calibrated)
    assert (status, err) == (0, "")
    assert "6 of 6 pictures show the 9x6 board" in out
    assert re.search(r"^least sure: \d+\.\d+ px at \d+ degrees \w+", out, re.MULTILINE)
    gains = re.findall(r"^(\d)\. worst uncertainty (\d+\.\d+) px .* -> (\d+\.\d+) px", out, re.MULTILINE)
    assert [number for number, _, _ in gains] == ["1", "2", "3"]
    assert all(float(after) < float(before) for _, before, after in gains)
    assert [after for *_, after in gains[:-1]] == [before for _, before, _ in gains[1:]]
    assert len(re.findall(r"Where: .* at pixel \(\d+, \d+\), \d+ degrees from the axis\.", out)) == 3
    # The length of the board comes with the camera's file: 8 squares of 30 mm.
    for widths, centimetres in re.findall(r"How far: (\d\.\d) board widths \((\d+) cm\)", out):
        assert float(centimetres) == pytest.approx(24 * float(widths), abs=2)
    tilts = re.findall(r"How tilted: (.*)\.$", out, re.MULTILINE)
    assert len(tilts) == 3
    for tilt in tilts:
        told = r"(30|45) degrees, its (upper|lower|left|right) edge towards the camera|not at all: it faces the camera"
        assert re.fullmatch(told, tilt)
    # A lens with four numbers is known well from six pictures.
    assert "more pictures will hardly help" in out


def test_json_is_one_object_with_poses(run, shots, calibrated):
    status, out, err = run("next", shots, "--camera", calibrated, "--count", 2, "--json")
    assert (status, err) == (0, "")
    said = json.loads(out)
    assert said["pictures"] == 6
    assert said["board"]["square"] == "30mm"
    assert said["worst"]["px"] >= said["worst_calibrated"]["px"] > 0
    assert len(said["next"]) == 2
    for view in said["next"]:
        rotation = np.array(view["cam_from_board"]["rotation"])
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        middle = rotation @ [0.12, 0.075, 0] + view["cam_from_board"]["translation"]
        assert np.linalg.norm(middle) == pytest.approx(view["distance"])
        np.testing.assert_allclose(TRUTH.project(middle)[0], view["pixel"], atol=3)
        assert view["unit"] == "m"
        assert view["after"]["px"] < view["before"]["px"]
        assert view["words"].startswith("Where: ")


def test_the_nearer_edge_is_named_as_the_picture_shows_it(run, shots, calibrated):
    said = json.loads(run("next", shots, "--camera", calibrated, "--json")[1])
    tilted = [view for view in said["next"] if view["tilt_deg"]]
    assert tilted
    for view in tilted:
        rotation, translation = (np.array(view["cam_from_board"][key]) for key in ("rotation", "translation"))
        corners = BOARD.points * 0.03 @ rotation.T + translation
        pixels, _ = TRUTH.project(corners)
        # The nearest corners lie, from the board's middle, towards the edge that is named.
        near = pixels[np.argsort(np.linalg.norm(corners, axis=1))[:6]].mean(0) - view["pixel"]
        u, v = near
        name = ("right" if u > 0 else "left") if abs(u) > abs(v) else ("lower" if v > 0 else "upper")
        assert view["nearer_edge"] == name


def test_the_drawing_shows_the_boards_over_a_picture(run, shots, calibrated, tmp_path):
    drawn = tmp_path / "next.png"
    status, out, _ = run("next", shots, "--camera", calibrated, "-o", drawn, "--count", 1)
    assert status == 0
    assert f"drawn: {drawn}" in out
    image = read_image(drawn)
    assert image.shape[1] > image.shape[0] > SIZE[1]
    # The proposed board is black and white, at the pixel that is told.
    u, v = map(int, re.search(r"at pixel \((\d+), (\d+)\)", out).groups())
    zoom = image.shape[0] / SIZE[1]
    patch = image[round(v * zoom) - 80 : round(v * zoom) + 80, round(u * zoom) - 80 : round(u * zoom) + 80]
    assert patch.min() < 60
    assert (patch.min(2) > 180).mean() > 0.1


def test_a_camera_without_a_board_leaves_it_to_the_pictures(run, shots, camera_file):
    status, out, _ = run("next", shots, "--camera", camera_file, "--count", 1)
    assert status == 0
    assert "the 9x6 board" in out
    assert "squares) from the camera" in out


def test_another_camera_is_refused(refuses, shots, tmp_path):
    other = save(replace(TRUTH, size=(1280, 960)), tmp_path / "other.json").path
    said = refuses("next", shots, "--camera", other)
    assert "the pictures are 640x480, the camera 1280x960" in said
    narrow = save(
        replace(TRUTH, model=TRUTH.model.with_params([9.0, 900.0, 10.0, 10.0])), tmp_path / "narrow.json"
    ).path
    assert "does not explain these pictures" in refuses("next", shots, "--camera", narrow)


def test_a_size_that_the_file_does_not_say_is_that_of_the_pictures(run, shots, tmp_path):
    unsized = save(replace(TRUTH, size=(0, 0)), tmp_path / "unsized.json").path
    assert run("next", shots, "--camera", unsized, "--count", 1)[0] == 0


@pytest.mark.parametrize("target", [{"target": "checkerboard"}, {"target": "../x", "columns": 9}, {"columns": "many"}])
def test_a_board_in_the_file_that_is_none_is_refused(refuses, shots, tmp_path, target):
    spoilt = save(replace(TRUTH, provenance={"target": target}), tmp_path / "spoilt.json").path
    said = refuses("next", shots, "--camera", spoilt)
    assert "spoilt.json: provenance, target" in said
    assert "give --pattern or --target" in said


def test_what_cannot_work_is_said_before_the_work(refuses, folder, calibrated, tmp_path):
    assert "--count is 0" in refuses("next", folder, "--camera", calibrated, "--count", 0)
    assert "holds the pictures" in refuses("next", folder, "--camera", calibrated, "-o", folder / "next.png")
    assert "is one of the pictures" in refuses("next", folder, "--camera", calibrated, "-o", folder / "1.png")
    assert "no folder" in refuses("next", folder, "--camera", calibrated, "-o", tmp_path / "none" / "next.png")
    assert ".png or .jpg" in refuses("next", folder, "--camera", calibrated, "-o", tmp_path / "next.txt")


def test_pictures_without_a_board_are_refused(refuses, calibrated, tmp_path):
    empty = tmp_path / "empty"
    empty.mkdir()
    write_image(empty / "1.png", np.full(SIZE[::-1], 90, np.uint8))
    said = refuses("next", empty, "--camera", calibrated)
    assert "found in none of 1 pictures" in said
    assert "1.png" in said
