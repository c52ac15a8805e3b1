"""Disks that are full, folders that take nothing, and places that one does not work from."""

import errno
import os

import pytest
from cli_scene import QUICK, file_names

from omnisight.formats import load


@pytest.fixture
def full_disk(monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("omnisight.images.write.os.replace", refuse)


@pytest.mark.usefixtures("full_disk")
def test_disk_full_at_the_end_names_the_file_and_leaves_the_old_camera(run, shots, tmp_path):
    kept = tmp_path / "camera.json"
    kept.write_text("what was there")
    status, out, err = run("calibrate", shots, *QUICK, "-o", kept)
    assert status == 2
    assert "verdict: " in out  # the figures of a long run are not lost with the file
    assert f"cannot write {kept}: No space left on device" in err
    assert kept.read_text() == "what was there"
    assert file_names(tmp_path) == ["camera.json"]


def test_read_only_cache_costs_no_run(run, shots, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr("omnisight.targets.cache.cache_folder", lambda: tmp_path / "file" / "cache")
    status, out, err = run("detect", shots / "1.png", "--pattern", "9x6", "-o", tmp_path / "drawn")
    assert (status, err) == (0, "")
    assert "9x6: 1 of 1 images" in out


def test_read_only_folder_for_drawings_is_told_by_name(run, shots, tmp_path):
    (tmp_path / "file").write_text("")
    status, _, err = run("detect", shots / "1.png", "--pattern", "9x6", "-o", tmp_path / "file" / "drawn")
    assert status == 2
    assert str(tmp_path / "file") in err


@pytest.mark.skipif(os.name == "nt", reason="a folder in use cannot be deleted there")
def test_odd_working_dir_that_is_gone_is_no_matter(run, shots, tmp_path, monkeypatch):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    try:
        status, out, err = run("calibrate", shots, *QUICK, "-o", tmp_path / "camera.json")
    finally:
        os.chdir(tmp_path)
    assert (status, err) == (0, "")
    assert f"written: {tmp_path / 'camera.json'}" in out
    assert load(tmp_path / "camera.json").size == (640, 480)


def test_paths_with_a_line_break_or_dash_are_files_like_any(run, shots, tmp_path):
    for name in ("-o.png", "two\nlines.png", " .png"):
        (tmp_path / name).write_bytes((shots / "1.png").read_bytes())
    status, out, err = run("detect", tmp_path, "--pattern", "9x6", "-o", tmp_path / "drawn")
    assert (status, err) == (0, "")
    assert "9x6: 3 of 3 images" in out
