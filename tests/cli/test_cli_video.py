"""omnisight detect and calibrate with video clips."""

import json
import re
import shutil

import numpy as np
import pytest

from clips import BOARD, POSE_COUNT, SETUP, rendered_clip, write_clip
from lenses import bearing_error
from omnisight.formats import load
from omnisight.images import Clip, write_image


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    return write_clip(tmp_path_factory.mktemp("clip") / "board.avi", rendered_clip()[0])


@pytest.fixture(autouse=True)
def frames_in_the_cache(environment, shared_cache, monkeypatch):
    monkeypatch.setattr("omnisight.calibration.frame_selection.frames_folder", lambda: shared_cache / "frames")


def test_the_most_informative_frames_of_a_clip_are_used(run, clip, tmp_path):
    status, out, err = run("detect", clip, "-o", tmp_path / "drawn")
    assert (status, err) == (0, "")
    note = re.search(r"board\.avi: (\d+) frames, (\d+) searched, (\d+) with a board, (\d+) selected", out)
    total, searched, detected, selected = map(int, note.groups())
    assert total > searched > detected > selected >= 5
    lines = [line.split() for line in out.splitlines() if line.startswith("board-")]
    assert len(lines) == selected
    assert all(boards == "1" and int(corners) > 40 for _, boards, corners, *_ in lines)
    assert f"detected  9x6 in {selected} of {selected} images" in out
    assert sorted(path.name for path in (tmp_path / "drawn").iterdir()) == [name for name, *_ in lines]


def test_a_clip_is_calibrated_like_images(run, clip, tmp_path):
    status, out, err = run("calibrate", clip, "--model", "kannala_brandt", "-o", tmp_path / "camera.json")
    assert (status, err) == (0, "")
    assert "with a board" in out
    camera = load(tmp_path / "camera.json")
    assert bearing_error(camera, SETUP.camera, np.radians(80)) < 0.1
    assert len(camera.provenance["images"]) >= 5
    assert all(name.startswith("board-") for name in camera.provenance["images"])


def test_a_clip_of_single_images_is_not_blurred_by_the_motion_between_them(run, tmp_path):
    frames, labels = rendered_clip()
    single = [frames[labels.index(k)] for k in range(POSE_COUNT)]
    status, out, err = run("detect", write_clip(tmp_path / "slow.avi", single, frame_rate=2))
    assert (status, err) == (0, "")
    assert f"{POSE_COUNT} with a board, {POSE_COUNT} selected" in out


def test_clips_and_images_of_one_size_are_combined(run, clip, tmp_path):
    image = SETUP.renderer(samples=1)(SETUP.boards(1, BOARD, seed=9)).image
    write_image(tmp_path / "image.png", image)
    status, out, err = run("calibrate", tmp_path / "image.png", clip, "--model", "kannala_brandt", "--json")
    assert (status, err) == (0, "")
    names = [entry["name"] for entry in json.loads(out)["images"]]
    assert "image.png" in names
    assert sum(name.startswith("board-") for name in names) == len(names) - 1
    write_image(tmp_path / "small.png", image[::2, ::2].copy())
    status, out, err = run("detect", tmp_path / "small.png", clip, "--json")
    assert (status, err) == (0, "")
    (small, *_) = (entry for entry in json.loads(out)["images"] if entry["name"] == "small.png")
    assert "left out; half of" in small["note"]
    assert any(note.startswith("images have 2 sizes") for note in json.loads(out)["notes"])


def test_an_unreadable_clip_is_left_out_with_the_reason(run, clip, tmp_path):
    shutil.copy(clip, tmp_path / "good.avi")
    (tmp_path / "bad.mp4").write_text("no video data")
    status, out, err = run("detect", tmp_path, "--json")
    assert (status, err) == (0, "")
    notes = {entry["name"]: entry["note"] for entry in json.loads(out)["images"]}
    assert notes["bad.mp4"] == "not a video (starts with the text 'no video data')"
    assert any(name.startswith("good-") for name in notes)


@pytest.mark.parametrize("command", ["detect", "calibrate"])
def test_only_an_unreadable_clip_is_rejected_with_the_reason(refuses, tmp_path, command):
    (tmp_path / "bad.mp4").write_bytes(b"")
    error = refuses(command, tmp_path / "bad.mp4")
    assert "bad.mp4: empty file; copy it from the camera again" in error


def test_a_wrong_pattern_gives_a_hint(refuses, clip):
    error = refuses("calibrate", clip, "--pattern", "5x3")
    assert "found a grid of 9x6 inner corners" in error
    assert "Use --pattern 9x6" in error


def test_a_second_run_reuses_the_selected_frames(run, clip, monkeypatch):
    first = run("detect", clip, "--json")
    monkeypatch.setattr(Clip, "frames", None)
    assert run("detect", clip, "--json") == first
