"""omnisight calibrate."""

import json
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
from cli_scene import QUICK, SIZE, TRUTH, file_names, image_rows, raises_error, remarks

from omnisight.formats import load
from omnisight.images import read_image, write_image


def test_a_calibration_needs_no_options_and_prints_a_row_per_image(run, shots, tmp_path):
    status, out, err = run("calibrate", shots, "--square", "30mm", "-o", tmp_path / "camera.json")
    assert (status, err) == (0, "")
    table = image_rows(out)
    assert sorted(table) == sorted(path.name for path in shots.iterdir())
    for line in table.values():
        _, corners, rms, worst = line.split()[:4]
        assert 40 <= int(corners) <= 54
        assert 0 < float(rms) < float(worst) < 0.5
    assert f"written   {tmp_path / 'camera.json'}" == out.splitlines()[-1]
    assert "6 of 6 images" in out
    camera = load(tmp_path / "camera.json")
    assert camera.size == SIZE
    assert camera.provenance["pattern"] == "9x6"
    assert camera.provenance["target"] == {"target": "checkerboard", "columns": 9, "rows": 6, "square": "30mm"}
    pixels, _ = TRUTH.project([[0.6, 0.2, 1.0], [-0.8, 0.1, 1.0], [0.0, -0.7, 1.0]])
    # Angles between bearings do not depend on the rotation of the camera.
    true_angles, angles = (
        np.degrees(np.arccos(np.clip(bearings @ bearings.T, -1, 1)))
        for bearings in (TRUTH.unproject(pixels)[0], camera.unproject(pixels)[0])
    )
    assert true_angles[~np.eye(3, dtype=bool)].min() > 30
    np.testing.assert_allclose(angles, true_angles, atol=0.2)


def test_the_output_is_short_and_verbose_adds_tests_and_timings(run, shots):
    status, out, _ = run("calibrate", shots, *QUICK)
    assert status == 0
    images, models, result = out.split("\n\n")
    assert len(images.splitlines()) == 7
    assert [line.split()[0] for line in models.splitlines()] == ["model", "equidistant"]
    labels = [line[:10].strip() for line in result.splitlines()]
    assert [label for label in labels if label] == ["camera", "accuracy", "verdict", "written"]
    assert "camera    equidistant, 640x480, calibrated to " in result
    assert re.search(
        r"^accuracy  held-out error 0\.\d+ px; projection uncertainty 0\.\d+ px \(1σ\), at most", result, re.M
    )
    assert result.splitlines()[-1] == "written   camera.json"
    status, verbose, _ = run("calibrate", shots, *QUICK, "-v")
    assert status == 0
    added = {line[:10].strip() for line in verbose.splitlines()} - {line[:10].strip() for line in out.splitlines()}
    assert added >= {"spline", "central", "redetect", "remark", "time"}
    assert remarks(verbose) == [
        "lengths are in squares (the size of the board is not specified); the camera is unaffected"
    ]


def test_the_camera_file_contains_model_convention_and_board(run, shots, tmp_path):
    assert run("calibrate", shots, *QUICK, "-o", tmp_path / "camera.json")[0] == 0
    stored = json.loads((tmp_path / "camera.json").read_text())
    assert stored["format"] == "omnisight-camera"
    assert stored["version"] == 1
    assert stored["model"] == "equidistant"
    assert stored["size"] == [640, 480]
    assert set(stored["params"]) == {"fx", "fy", "cx", "cy"}
    assert "x right, y down, z forward" in stored["convention"]
    assert stored["provenance"]["target"]["square"] is None
    assert stored["calibration"]["images"] == 6


def test_json_is_one_object_and_nothing_else(run, folder):
    (folder / "7.jpg").write_text("not an image")
    write_image(folder / "8.png", np.zeros(SIZE[::-1], np.uint8))
    status, out, err = run("calibrate", folder, "--pattern", "9x6", "--json")
    assert (status, err) == (0, "")
    result = json.loads(out)
    assert set(result) >= {
        *("images", "pattern", "model", "rms", "mean", "held_out_rms"),
        *("redetection", "verdict", "reasons", "remarks", "candidates", "noncentrality", "seconds", "camera"),
        "reason",
    }
    assert [image["name"] for image in result["images"]] == file_names(folder)
    for image in result["images"]:
        assert set(image) == {"name", "found", "corners", "rms", "worst", "note"}
        assert image["found"] is (int(image["name"][0]) <= 6)
        assert (image["rms"] is None) is (image["worst"] is None) is (not image["found"])
    assert result["images"][6]["note"] == "not an image (starts with the text 'not an image')"
    assert result["images"][7]["note"] == "no 9x6 board detected"
    assert result["pattern"] == "9x6"
    assert 0 < result["mean"] < result["rms"] < 0.3
    assert {"model", "corners", "rms", "held_out_rms", "parameters", "mean", "probability"} == set(
        result["candidates"][0]
    )
    assert len(result["candidates"]) > 3
    assert result["seconds"]["total"] == pytest.approx(
        sum(result["seconds"][stage] for stage in ("detect", "redetect", "solve")), abs=0.01
    )
    assert result["camera"]["model"] == result["model"]
    assert result["camera"]["size"] == [640, 480]


def test_json_of_a_new_process_is_all_of_stdout(shots, tmp_path):
    command = [sys.executable, "-m", "omnisight", "calibrate", str(shots), *QUICK, "--json", "--no-cache"]
    done = subprocess.run([*command, "-o", str(tmp_path / "c.json")], capture_output=True, text=True, check=True)
    result = json.loads(done.stdout)
    assert done.stderr == ""
    assert result["camera"]["params"] == json.loads((tmp_path / "c.json").read_text())["params"]


def test_a_second_run_reuses_the_detections(run, shots, tmp_path, monkeypatch):
    monkeypatch.setattr("omnisight.targets.cache.cache_folder", lambda: tmp_path / "cache")
    first = run("calibrate", shots, *QUICK)[1]
    copy = shutil.copytree(shots, tmp_path / "copy")
    monkeypatch.setattr("omnisight.targets.raw_detections.find_grids", raises_error(AssertionError("detected again")))
    assert image_rows(run("calibrate", copy, *QUICK)[1]) == image_rows(first)
    assert run("calibrate", shots, *QUICK, "--no-cache")[0] == 1


def test_residuals_are_drawn_on_every_image(run, shots, tmp_path):
    status, out, _ = run("calibrate", shots, *QUICK, "--draw", tmp_path / "drawn")
    assert status == 0
    assert f"drawn     {tmp_path / 'drawn'}" in out
    assert file_names(tmp_path / "drawn") == [f"{i}.png" for i in range(1, 7)]
    drawn = read_image(tmp_path / "drawn" / "1.png")
    assert drawn.shape[2] == 3
    green = (drawn[..., 1] > 180) & (drawn[..., 0] < 120)
    assert green.sum() > 500


def test_a_failed_drawing_loses_no_result(run, shots, tmp_path, monkeypatch):
    monkeypatch.setattr("omnisight.report.drawings.residuals.draw_residuals", raises_error(OSError("no space")))
    status, out, err = run("calibrate", shots, *QUICK, "--draw", tmp_path / "drawn", "-o", tmp_path / "c.json")
    assert (status, err) == (2, "omnisight: no space\n")
    assert f"written   {tmp_path / 'c.json'}" in out
    assert load(tmp_path / "c.json").model.name == "equidistant"


def test_images_of_equal_names_in_two_folders_are_distinguished(run, shots, tmp_path):
    for name, numbers in (("left", (1, 2, 3)), ("right", (4, 5, 6))):
        (tmp_path / name).mkdir()
        for i, number in enumerate(numbers):
            shutil.copy(shots / f"{number}.png", tmp_path / name / f"{i}.png")
    status, out, _ = run("calibrate", tmp_path / "left", tmp_path / "right", *QUICK, "--json")
    separate = json.loads(out)["images"]
    together = json.loads(run("calibrate", shots, *QUICK, "--json")[1])["images"]
    assert status == 0
    assert len({row["name"] for row in separate}) == 6
    assert [row["corners"] for row in separate] == [row["corners"] for row in together]
    np.testing.assert_allclose([row["rms"] for row in separate], [row["rms"] for row in together], rtol=1e-6)
    run("calibrate", tmp_path / "left", tmp_path / "right", *QUICK, "--draw", tmp_path / "drawn")
    assert len(file_names(tmp_path / "drawn")) == 6


def test_dropped_images_are_left_out_and_unknown_names_are_rejected(run, refuses, shots):
    status, out, _ = run("calibrate", shots, *QUICK, "--drop", "2.png", "--drop", "5.png")
    assert status == 0
    assert sorted(image_rows(out)) == [name for name in file_names(shots) if name not in ("2.png", "5.png")]
    error = refuses("calibrate", shots, *QUICK, "--drop", "nine.png")
    assert "--drop: there is no image nine.png; there are 1.png, 2.png" in error
    error = refuses("calibrate", shots, *QUICK, "--drop", "2")
    assert "--drop: there is no image 2 (did you mean 2.png?); there are" in error
    error = refuses("calibrate", shots, *QUICK, "--fix", "fxx")
    assert "no candidate model has a parameter fxx (did you mean fx?); there are: " in error


def test_the_ocamcalib_method_prints_its_steps_and_writes_its_camera(run, shots, tmp_path):
    status, out, _ = run(
        *("calibrate", shots, "--pattern", "9x6", "--model", "kannala_brandt", "--method", "ocamcalib"),
        *("-o", tmp_path / "camera.json"),
    )
    assert status == 0
    rms = {step: float(value) for step, value in re.findall(r"^ocamcalib, (\w+) +(\d\.\d+)", out, re.M)}
    assert rms["refined"] <= rms["centred"] <= rms["linear"]
    assert re.search(r"^kannala_brandt +8 +0\.\d+ +0\.\d+ +100% +selected$", out, re.M)
    camera = load(tmp_path / "camera.json")
    assert camera.model.name == "ocam"
    assert camera.calibration["method"] == "ocamcalib"
    assert camera.calibration["rms"] == pytest.approx(rms["refined"], abs=6e-4)
    # The quality is that of omnisight's camera, which is not written.
    assert f"written   {tmp_path / 'camera.json'}: the camera of ocamcalib, to which accuracy and verdict" in out
    assert "verdict" not in camera.calibration
    assert camera.calibration["omnisight"]["model"] == "kannala_brandt"
    assert camera.calibration["omnisight"]["verdict"] in ("good", "usable", "do not use")


def test_the_verdict_and_its_reasons_are_printed_stored_and_in_json(run, shots, tmp_path):
    few = sorted(shots.iterdir())[:3]
    status, out, _ = run("calibrate", *few, *QUICK, "-o", tmp_path / "camera.json", "--verbose")
    assert status == 0
    stored = load(tmp_path / "camera.json").calibration
    assert f"verdict   {stored['verdict'].upper()}\n" in out
    assert stored["verdict"] in ("good", "usable", "do not use")
    assert stored["reasons"]
    assert [line[12:] for line in out.splitlines() if line.startswith(" " * 10 + "- ")] == stored["reasons"]
    result = json.loads(run("calibrate", *few, *QUICK, "--json")[1])
    assert (result["verdict"], result["reasons"]) == (stored["verdict"], stored["reasons"])


def test_a_report_is_one_page_and_its_failure_loses_no_camera(run, shots, tmp_path, monkeypatch):
    page, camera = tmp_path / "report.html", tmp_path / "camera.json"
    status, out, _ = run("calibrate", shots, *QUICK, "--report", page)
    assert status == 0
    assert f"report    {page}" == out.splitlines()[-1]
    assert 'id="calibration"' in page.read_text(encoding="utf-8")
    monkeypatch.setattr("omnisight.report.page.write_report", raises_error(OSError(28, "No space left on device")))
    status, _, err = run("calibrate", shots, *QUICK, "--report", page, "-o", camera)
    assert status != 0
    assert "No space left" in err
    assert load(camera).size == SIZE


def test_a_report_without_a_folder_is_rejected(refuses, shots, tmp_path):
    assert "there is no folder" in refuses("calibrate", shots, *QUICK, "--report", tmp_path / "no" / "report.html")


def test_a_report_of_another_format_is_refused_before_any_work(refuses, shots, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "omnisight.pipeline.calibration.calibrate.calibrate", raises_error(AssertionError("images were read"))
    )
    error = refuses("calibrate", shots, *QUICK, "--report", tmp_path / "r.pdf")
    assert "r.pdf: the report is written as HTML; name it r.html" in error
    assert file_names(tmp_path) == []


@pytest.mark.parametrize(
    ("option", "message"),
    [("-o", "is one of the inputs and would be overwritten"), ("--report", "the report is written as HTML")],
)
def test_an_image_is_never_overwritten(refuses, folder, option, message):
    image = folder / "1.png"
    before = image.read_bytes()
    assert message in refuses("calibrate", folder, *QUICK, option, image)
    assert image.read_bytes() == before


def test_camera_and_report_need_two_files(refuses, shots, tmp_path):
    one = tmp_path / "one.json"
    assert "specify two files" in refuses("calibrate", shots, *QUICK, "-o", one, "--report", one)


def test_dropping_all_images_is_rejected(refuses, shots):
    drops = [word for name in file_names(shots) for word in ("--drop", name)]
    assert "--drop leaves no image" in refuses("calibrate", shots, *QUICK, *drops)


def test_the_default_output_is_camera_json_and_replaces_no_file(run, shots, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, out, _ = run("calibrate", shots, *QUICK)
    assert (status, out.splitlines()[-1]) == (0, "written   camera.json")
    written = (tmp_path / "camera.json").read_bytes()
    monkeypatch.setattr(
        "omnisight.pipeline.detection.detect.detect_boards", raises_error(AssertionError("detection started"))
    )
    status, out, err = run("calibrate", shots, *QUICK)
    assert (status, out) == (2, "")
    assert "camera.json: exists; specify the file to write: -o camera.json replaces it" in err
    assert (tmp_path / "camera.json").read_bytes() == written


def test_json_output_writes_no_file_without_output(run, shots, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run("calibrate", shots, *QUICK, "--json")[0] == 0
    assert file_names(tmp_path) == []


@pytest.mark.parametrize("name", ["c.yaml", "c.cameramodel", "c.txt"])
def test_a_camera_file_is_named_json(refuses, shots, tmp_path, name):
    error = refuses("calibrate", shots, *QUICK, "-o", tmp_path / name)
    assert "is written as .json; name it c.json, and convert it afterwards: omnisight convert c.json --to" in error


@pytest.mark.parametrize("stage", ["cross_validate", "fit_spline_baseline", "assess"])
def test_an_interrupted_calibration_writes_the_best_camera_so_far(run, shots, tmp_path, monkeypatch, stage):
    monkeypatch.setattr(f"omnisight.pipeline.calibration.calibrate.{stage}", raises_error(KeyboardInterrupt()))
    file = tmp_path / "camera.json"
    status, out, err = run("calibrate", shots, *QUICK, "-o", file)
    assert (status, out) == (130, "")
    assert err == f"written   {file}: the best camera so far, its accuracy was not assessed\nomnisight: interrupted\n"
    camera = load(file)
    assert camera.model.fx == pytest.approx(TRUTH.model.fx, rel=0.01)
    assert camera.calibration["verdict"] == "do not use"
    assert camera.calibration["reasons"] == ["Interrupted before the accuracy was assessed. Calibrate again."]


def test_an_interruption_before_any_fit_writes_nothing(run, shots, tmp_path, monkeypatch):
    monkeypatch.setattr("omnisight.pipeline.calibration.calibrate.fit_candidates", raises_error(KeyboardInterrupt()))
    assert run("calibrate", shots, *QUICK, "-o", tmp_path / "c.json") == (130, "", "omnisight: interrupted\n")
    assert file_names(tmp_path) == []
