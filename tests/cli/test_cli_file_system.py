"""Full disks, read-only folders, a deleted working directory and unusual file names."""

import errno
import os

import pytest
from cli_scene import QUICK, file_names

from omnisight.formats import load


@pytest.fixture
def full_disk(monkeypatch):
    def raise_no_space(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("omnisight.images.write.os.replace", raise_no_space)


@pytest.mark.usefixtures("full_disk")
def test_a_full_disk_keeps_the_old_camera_and_the_printed_result(run, shots, tmp_path):
    old = tmp_path / "camera.json"
    old.write_text("old content")
    status, out, err = run("calibrate", shots, *QUICK, "-o", old)
    assert status == 2
    assert "verdict   " in out  # the result of a long run is not lost with the file
    assert f"cannot write {old}: No space left on device" in err
    assert old.read_text() == "old content"
    assert file_names(tmp_path) == ["camera.json"]


def test_a_read_only_cache_is_ignored(run, shots, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr("omnisight.targets.cache.cache_folder", lambda: tmp_path / "file" / "cache")
    status, out, err = run("detect", shots / "1.png", "--pattern", "9x6", "-o", tmp_path / "drawn")
    assert (status, err) == (0, "")
    assert "detected  9x6 in 1 of 1 images" in out


def test_a_read_only_folder_for_drawings_is_named(run, shots, tmp_path):
    (tmp_path / "file").write_text("")
    status, _, err = run("detect", shots / "1.png", "--pattern", "9x6", "-o", tmp_path / "file" / "drawn")
    assert status == 2
    assert str(tmp_path / "file") in err


@pytest.mark.skipif(os.name == "nt", reason="a folder in use cannot be deleted there")
def test_a_deleted_working_directory_is_no_error(run, shots, tmp_path, monkeypatch):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    try:
        status, out, err = run("calibrate", shots, *QUICK, "-o", tmp_path / "camera.json")
    finally:
        os.chdir(tmp_path)
    assert (status, err) == (0, "")
    assert f"written   {tmp_path / 'camera.json'}" in out
    assert load(tmp_path / "camera.json").size == (640, 480)


def test_file_names_may_contain_a_line_break_dash_or_space(run, shots, tmp_path):
    for name in ("-o.png", "two\nlines.png", " .png"):
        (tmp_path / name).write_bytes((shots / "1.png").read_bytes())
    status, out, err = run("detect", tmp_path, "--pattern", "9x6", "-o", tmp_path / "drawn")
    assert (status, err) == (0, "")
    assert "detected  9x6 in 3 of 3 images" in out
