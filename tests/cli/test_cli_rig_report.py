"""omnisight calibrate-rig: report and drawings."""

import json

import cv2
import numpy as np
import pytest


@pytest.fixture
def folders(tmp_path):
    """Return two folders with an image without a board each."""
    for name in ("left", "right"):
        (tmp_path / name).mkdir()
        cv2.imwrite(str(tmp_path / name / "1.png"), np.zeros((48, 64), np.uint8))
    return tmp_path / "left", tmp_path / "right"


def test_the_report_must_not_be_the_rig(run, folders, tmp_path):
    status, _, err = run("calibrate-rig", *folders, "-o", tmp_path / "rig.json", "--report", tmp_path / "rig.json")
    assert status == 2
    assert "specified for both the rig and the report" in err


def test_the_report_needs_a_folder_that_exists(run, folders, tmp_path):
    status, _, err = run(
        "calibrate-rig", *folders, "-o", tmp_path / "rig.json", "--report", tmp_path / "no" / "rig.html"
    )
    assert status == 2
    assert "there is no folder" in err


def test_no_output_overwrites_an_image(run, folders, tmp_path):
    image = folders[0] / "1.png"
    before = image.read_bytes()
    status, _, err = run("calibrate-rig", *folders, "-o", tmp_path / "rig.json", "--report", image)
    assert status == 2
    assert "the report is written as HTML" in err
    assert image.read_bytes() == before


def test_drawings_are_not_mixed_with_the_images(run, folders, tmp_path):
    status, _, err = run("calibrate-rig", *folders, "-o", tmp_path / "rig.json", "--draw", tmp_path)
    assert status == 2
    assert str(folders[0]) in err
    assert not (tmp_path / "rig.json").exists()


@pytest.mark.slow
def test_report_and_drawings_of_real_fisheyes(run, data, tmp_path):
    folder = data("stereo_fisheye_sourishg")
    rig, report, drawings = tmp_path / "rig.json", tmp_path / "rig.html", tmp_path / "drawings"
    status, out, err = run(
        "calibrate-rig",
        folder / "left1*.jpg",
        folder / "right1*.jpg",
        *("--square", "24.23mm", "--model", "kannala_brandt"),
        *("-o", rig, "--report", report, "--draw", drawings),
    )
    assert (status, err) == (0, "")
    assert f"report    {report}" in out
    assert list(json.loads(rig.read_text())["sensors"]) == ["left1", "right1"]
    for name in ("left1", "right1"):
        files = sorted(file.stem for file in (drawings / name).iterdir())
        assert files == sorted(file.stem for file in folder.glob(f"{name}*.jpg"))
        drawn, original = (
            cv2.imread(str(file)) for file in (drawings / name / f"{files[0]}.png", folder / f"{files[0]}.jpg")
        )
        drawn = cv2.resize(drawn, original.shape[1::-1])
        green = (drawn[..., 1].astype(int) - drawn[..., [0, 2]].max(-1)) > 60
        assert green.any()
    text = report.read_text(encoding="utf-8")
    assert "<h2>Rig in 3-D</h2>" in text
    assert "left1, right1" in text
