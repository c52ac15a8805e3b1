"""omnisight calibrate: paths of images and outputs."""

import glob
import shutil

import pytest
from cli_scene import QUICK, SIZE, file_names, raises_error

from omnisight.formats import load


@pytest.mark.parametrize("name", ["with a space", "Prüfbilder 校正", "weird [1] {a}'s"])
def test_paths_may_contain_spaces_accents_and_brackets(run, shots, tmp_path, name):
    copy = shutil.copytree(shots, tmp_path / name)
    (copy / "1.png").rename(copy / f"1 {name}.png")
    out = copy / f"{name}.json"
    status, text, _ = run("calibrate", copy, *QUICK, "-o", out, "--draw", copy / "drawn")
    assert status == 0
    assert "6 of 6 images" in text
    assert load(out).size == SIZE
    assert f"1 {name}.png" in file_names(copy / "drawn")
    assert "4 of 4 images" in run("calibrate", f"{glob.escape(str(copy))}/[2-5].png", *QUICK)[1]


@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        ("no folder", "there is no folder"),
        ("under a file", "file is a file, not a folder"),
        ("a folder itself", "is a folder"),
    ],
)
def test_an_output_without_a_folder_is_rejected_before_detection(refuses, shots, tmp_path, monkeypatch, kind, reason):
    monkeypatch.setattr(
        "omnisight.pipeline.detection.detect.detect_boards", raises_error(AssertionError("detection started"))
    )
    (tmp_path / "file").write_text("")
    output = {
        "no folder": tmp_path / "missing" / "c.json",
        "under a file": tmp_path / "file" / "c.json",
        "a folder itself": tmp_path,
    }[kind]
    error = refuses("calibrate", shots, *QUICK, "-o", output)
    assert str(output) in error
    assert reason in error


def test_a_read_only_output_folder_is_rejected_before_detection(refuses, shots, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "omnisight.pipeline.detection.detect.detect_boards", raises_error(AssertionError("detection started"))
    )
    monkeypatch.setattr("tempfile.TemporaryFile", raises_error(PermissionError(13, "Permission denied")))
    error = refuses("calibrate", shots, *QUICK, "-o", tmp_path / "c.json")
    assert f"{tmp_path / 'c.json'}: cannot be written: Permission denied ({tmp_path})" in error


def test_a_failed_run_keeps_the_old_camera(refuses, shots, tmp_path):
    old = tmp_path / "camera.json"
    old.write_text("old content")
    refuses("calibrate", shots, "--pattern", "7x5", "-o", old)
    assert old.read_text() == "old content"
    assert file_names(tmp_path) == ["camera.json"]
