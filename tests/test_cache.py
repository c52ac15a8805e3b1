"""The cache folder: what was not used for the longest time is removed."""

import os
import time

import numpy as np
import pytest

from clips import write_clip
from omnisight import cache
from omnisight.calibration import frame_selection
from omnisight.targets import cache as detections


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("OMNISIGHT_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def make_folders(folder, count):
    """Make folders of compiled code, the oldest first."""
    made = [folder / f"{('loops', 'compiled')[i % 2]}-{i:016x}" for i in range(count)]
    for i, path in enumerate(made):
        path.mkdir(parents=True)
        (path / "code.nbc").write_bytes(b"code")
        os.utime(path, (time.time() - 1e6 + i,) * 2)
    return made


def test_the_code_that_was_last_used_is_kept(folder):
    made = make_folders(folder, cache.MAX_COMPILED_FOLDERS + 5)
    (folder / "detections").mkdir()
    os.utime(folder / "detections", (0, 0))
    cache.record_use(made[0])
    cache.record_use(made[1] / "ocam-sphere")
    cache.remove_old_code()
    assert set(cache.compiled_folders()) == {*made[:2], *made[7:]}
    assert sorted(path.name for path in folder.iterdir()) == sorted(
        ["detections", *(path.name for path in (*made[:2], *made[7:]))]
    )


def test_a_few_folders_and_no_folder_are_kept_as_they_are(folder):
    cache.remove_old_code()
    assert not folder.exists()
    made = make_folders(folder, 3)
    cache.remove_old_code()
    assert sorted(folder.iterdir()) == sorted(made)


def test_a_removal_that_was_interrupted_is_completed(folder):
    make_folders(folder, 1)
    (folder / "removed-1-loops-0").mkdir()
    cache.remove_old_code()
    assert len(list(folder.iterdir())) == 1


def test_the_use_of_other_folders_is_not_recorded(folder, tmp_path):
    os.utime(tmp_path, (0, 0))
    cache.record_use(tmp_path)
    assert tmp_path.stat().st_mtime == 0


def test_a_use_is_recorded_once_in_an_interval(folder):
    (made,) = make_folders(folder, 1)
    recent = time.time() - cache.USE_INTERVAL_S / 2
    os.utime(made, (recent, recent))
    cache.record_use(made)
    assert made.stat().st_mtime == pytest.approx(recent, abs=1)


def test_detections_that_were_last_used_are_kept(folder, monkeypatch):
    monkeypatch.setattr(detections, "MAX_ENTRIES", 3)
    monkeypatch.setattr(detections, "cache_folder", cache.cache_folder)
    for i in range(5):
        key = f"aa{i}"
        detections.save_entry(key, {"number": i})
        os.utime(folder / "detections" / "aa" / f"{key}.json", (time.time() - 1e6 + i,) * 2)
        detections.load_entry("aa0")
    detections.save_entry("bb0", {"number": 5})
    assert [i for i in range(5) if detections.load_entry(f"aa{i}")] == [0, 3, 4]
    assert detections.load_entry("bb0") == {"number": 5}


def test_frames_of_clips_that_were_not_used_for_a_day_are_removed(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(frame_selection, "MAX_CLIPS", 2)
    monkeypatch.setattr(frame_selection, "frames_folder", cache.frames_folder)
    files = []
    for i in range(3):
        clip = write_clip(tmp_path / f"{i}.avi", [np.full((48, 64, 3), 40 * i + frame, np.uint8) for frame in range(3)])
        files += frame_selection.write_frames(clip, [1])
    assert all(file.is_file() for file in files)  # a running command can need all of them
    for file in files:
        os.utime(file.parent, (time.time() - 1e6,) * 2)
    frame_selection.write_frames(tmp_path / "1.avi", [1])
    frame_selection.write_frames(tmp_path / "2.avi", [1, 2])
    assert [file.is_file() for file in files] == [False, True, True]
