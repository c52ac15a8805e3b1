"""omnisight detect and calibrate: clips in the place of images, and beside them."""

import json
import re
import shutil

import numpy as np
import pytest

from clips import BOARD, SETUP, rendered_clip, write_clip
from lenses import bearing_error
from omnisight.formats import load
from omnisight.images import Clip, write_image


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    return write_clip(tmp_path_factory.mktemp("clip") / "board.avi", rendered_clip()[0])


@pytest.fixture(autouse=True)
def frames_in_the_cache(environment, shared_cache, monkeypatch):
    monkeypatch.setattr("omnisight.calibration.frame_selection.cache_folder", lambda: shared_cache)


def test_detect_takes_a_clip_and_says_what_it_chose(run, shot, tmp_path):
    status, out, err = run("detect", shot, "-o", tmp_path / "drawn")
    assert (status, err) == (0, "")
    told = re.search(r"board\.avi: (\d+) frames, (\d+) looked at, (\d+) with a board, (\d+) chosen", out)
    count, looked, found, chosen = map(int, told.groups())
    assert count > looked > found > chosen >= 5
    lines = [line.split() for line in out.splitlines() if line.startswith("board-")]
    assert len(lines) == chosen
    assert all(boards == "1" and int(corners) > 40 for _, boards, corners, *_ in lines)
    assert f"9x6: {chosen} of {chosen} images" in out
    assert sorted(path.name for path in (tmp_path / "drawn").iterdir()) == [name for name, *_ in lines]


def test_a_clip_is_calibrated_as_pictures_are(run, shot, tmp_path):
    status, out, err = run("calibrate", shot, "--model", "kannala_brandt", "-o", tmp_path / "camera.json")
    assert (status, err) == (0, "")
    assert "with a board" in out
    camera = load(tmp_path / "camera.json")
    assert bearing_error(camera, SETUP.camera, np.radians(80)) < 0.1
    assert len(camera.provenance["images"]) >= 5
    assert all(name.startswith("board-") for name in camera.provenance["images"])


def test_clips_and_pictures_of_one_size_go_together(run, shot, tmp_path):
    picture = SETUP.renderer(samples=1)(SETUP.boards(1, BOARD, seed=9)).image
    write_image(tmp_path / "image.png", picture)
    status, out, err = run("calibrate", tmp_path / "image.png", shot, "--model", "kannala_brandt", "--json")
    assert (status, err) == (0, "")
    names = [entry["name"] for entry in json.loads(out)["images"]]
    assert "image.png" in names
    assert sum(name.startswith("board-") for name in names) == len(names) - 1
    write_image(tmp_path / "small.png", picture[::2, ::2].copy())
    status, out, err = run("detect", tmp_path / "small.png", shot, "--json")
    assert (status, err) == (0, "")
    (small, *_) = (entry for entry in json.loads(out)["images"] if entry["name"] == "small.png")
    assert "left out; half of" in small["note"]
    assert any(note.startswith("images have 2 sizes") for note in json.loads(out)["notes"])


def test_a_bad_clip_among_good_ones_is_left_out_with_its_reason(run, shot, tmp_path):
    shutil.copy(shot, tmp_path / "good.avi")
    (tmp_path / "bad.mp4").write_text("I am no clip")
    status, out, err = run("detect", tmp_path, "--json")
    assert (status, err) == (0, "")
    assert "bad.mp4: not a video (starts with b'I am ')" in out
    assert "good-" in out


@pytest.mark.parametrize("command", ["detect", "calibrate"])
def test_a_bad_clip_alone_is_refused_with_its_reason(refuses, tmp_path, command):
    (tmp_path / "bad.mp4").write_bytes(b"")
    said = refuses(command, tmp_path / "bad.mp4")
    assert "bad.mp4: empty file; copy it again from the camera" in said


def test_another_board_than_the_clip_shows_is_told(refuses, shot):
    said = refuses("calibrate", shot, "--pattern", "5x3")
    assert "found a 9x6 grid of inner corners" in said
    assert "Use --pattern 9x6" in said


def test_a_second_command_takes_the_choice_of_the_first(run, shot, monkeypatch):
    first = run("detect", shot, "--json")
    monkeypatch.setattr(Clip, "frames", None)
    assert run("detect", shot, "--json") == first
