"""The cache folder: compiled code of old versions is removed."""

import os
import time

import pytest

from omnisight import cache


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
    assert cache.compiled_folders() == [*sorted(made[:2], key=lambda path: -path.stat().st_mtime), *made[:6:-1]]
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
