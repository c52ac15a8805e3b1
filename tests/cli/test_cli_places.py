"""omnisight calibrate: where images lie and results go."""

import glob
import shutil

import pytest
from cli_scene import QUICK, SIZE, file_names, raises_error

from omnisight.formats import load


@pytest.mark.parametrize("name", ["with a space", "Prüfbilder 校正", "weird [1] {a}'s"])
def test_paths_may_be_named_as_people_name_them(run, shots, tmp_path, name):
    place = shutil.copytree(shots, tmp_path / name)
    (place / "1.png").rename(place / f"1 {name}.png")
    out = place / f"{name}.json"
    status, said, _ = run("calibrate", place, *QUICK, "-o", out, "--draw", place / "drawn")
    assert status == 0
    assert "6 of 6 images" in said
    assert load(out).size == SIZE
    assert f"1 {name}.png" in file_names(place / "drawn")
    assert "4 of 4 images" in run("calibrate", f"{glob.escape(str(place))}/[2-5].png", *QUICK)[1]


@pytest.mark.parametrize("where", ["no folder", "under a file", "a folder itself"])
def test_an_output_that_cannot_be_written_is_told_before_any_work(refuses, shots, tmp_path, monkeypatch, where):
    monkeypatch.setattr("omnisight.targets.detect_boards", raises_error(AssertionError("work was begun")))
    (tmp_path / "file").write_text("")
    output = {
        "no folder": tmp_path / "missing" / "c.json",
        "under a file": tmp_path / "file" / "c.json",
        "a folder itself": tmp_path,
    }[where]
    said = refuses("calibrate", shots, *QUICK, "-o", output)
    assert str(output) in said
    assert ("is a folder" if where == "a folder itself" else "there is no folder") in said


def test_a_folder_that_takes_no_file_is_told_before_any_work(refuses, shots, tmp_path, monkeypatch):
    monkeypatch.setattr("omnisight.targets.detect_boards", raises_error(AssertionError("work was begun")))
    monkeypatch.setattr("tempfile.TemporaryFile", raises_error(PermissionError(13, "Permission denied")))
    said = refuses("calibrate", shots, *QUICK, "-o", tmp_path / "c.json")
    assert f"{tmp_path / 'c.json'}: cannot be written: Permission denied ({tmp_path})" in said


def test_a_failed_run_leaves_the_old_camera_alone(refuses, shots, tmp_path):
    kept = tmp_path / "camera.json"
    kept.write_text("what was there")
    refuses("calibrate", shots, "--pattern", "7x5", "-o", kept)
    assert kept.read_text() == "what was there"
    assert file_names(tmp_path) == ["camera.json"]
