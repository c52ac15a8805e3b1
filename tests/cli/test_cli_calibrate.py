"""omnisight calibrate."""

import json
import shutil
import subprocess
import sys

import numpy as np
import pytest
from cli_scene import QUICK, SIZE, TRUTH, file_names, image_rows, raises_error

from omnisight.formats import load
from omnisight.images import read_image, write_image


def test_a_calibration_needs_no_options_and_prints_a_line_per_picture(run, shots, tmp_path):
    status, out, err = run("calibrate", shots, "--square", "30mm", "-o", tmp_path / "camera.json")
    assert (status, err) == (0, "")
    assert out.split()[:7] == ["image", "found", "corners", "rms", "px", "worst", "px"]
    table = image_rows(out)
    assert sorted(table) == sorted(path.name for path in shots.iterdir())
    for line in table.values():
        _, found, corners, rms, worst = line.split()[:5]
        assert found == "yes"
        assert 40 <= int(corners) <= 54
        assert 0 < float(rms) < float(worst) < 0.5
    assert f"written: {tmp_path / 'camera.json'}" in out
    assert "6 of 6 images" in out
    found = load(tmp_path / "camera.json")
    assert found.size == SIZE
    assert found.provenance["pattern"] == "9x6"
    assert found.provenance["target"] == {"target": "checkerboard", "columns": 9, "rows": 6, "square": "30mm"}
    pixels, _ = TRUTH.project([[0.6, 0.2, 1.0], [-0.8, 0.1, 1.0], [0.0, -0.7, 1.0]])
    true, shown = TRUTH.unproject(pixels)[0], found.unproject(pixels)[0]
    # A camera may be turned as a whole, so the angles between directions are compared.
    apart, found_apart = (np.degrees(np.arccos(np.clip(b @ b.T, -1, 1))) for b in (true, shown))
    assert apart[~np.eye(3, dtype=bool)].min() > 30
    np.testing.assert_allclose(found_apart, apart, atol=0.2)


def test_the_native_file_says_what_it_holds(run, shots, tmp_path):
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
        *("candidates", "seconds", "camera", "warnings", "reason"),
    }
    assert [picture["name"] for picture in result["images"]] == file_names(folder)
    for picture in result["images"]:
        assert set(picture) == {"name", "found", "corners", "rms", "worst", "note"}
        assert picture["found"] is (int(picture["name"][0]) <= 6)
        assert (picture["rms"] is None) is (picture["worst"] is None) is (not picture["found"])
    assert result["images"][6]["note"] == "7.jpg: not an image (starts with b'not a')"
    assert result["images"][7]["note"] == "no 9x6 board found"
    assert result["pattern"] == "9x6"
    assert 0 < result["mean"] < result["rms"] < 0.3
    assert {"model", "corners", "rms", "held_out_rms", "parameters", "mean"} == set(result["candidates"][0])
    assert len(result["candidates"]) > 3
    assert result["seconds"]["total"] == pytest.approx(
        result["seconds"]["detect"] + result["seconds"]["solve"], abs=0.5
    )
    assert result["camera"]["model"] == result["model"]
    assert result["camera"]["size"] == [640, 480]


def test_json_in_a_process_of_its_own_keeps_stdout_clean(shots, tmp_path):
    command = [sys.executable, "-m", "omnisight", "calibrate", str(shots), *QUICK, "--json", "--no-cache"]
    done = subprocess.run([*command, "-o", str(tmp_path / "c.json")], capture_output=True, text=True, check=True)
    result = json.loads(done.stdout)
    assert done.stderr == ""
    assert result["camera"]["params"] == json.loads((tmp_path / "c.json").read_text())["params"]


def test_a_second_run_takes_what_the_first_one_found(run, shots, tmp_path, monkeypatch):
    monkeypatch.setattr("omnisight.targets.cache.cache_folder", lambda: tmp_path / "cache")
    first = run("calibrate", shots, *QUICK)[1]
    renamed = tmp_path / "elsewhere"
    shutil.copytree(shots, renamed)
    monkeypatch.setattr("omnisight.targets.raw_detections.find_grids", raises_error(AssertionError("searched again")))
    assert image_rows(run("calibrate", renamed, *QUICK)[1]) == image_rows(first)
    assert run("calibrate", shots, *QUICK, "--no-cache")[0] == 1


def test_drawings_hold_every_picture(run, shots, tmp_path):
    status, out, _ = run("calibrate", shots, *QUICK, "--draw", tmp_path / "drawn")
    assert status == 0
    assert f"drawn: {tmp_path / 'drawn'}" in out
    assert file_names(tmp_path / "drawn") == [f"{i}.png" for i in range(1, 7)]
    drawn = read_image(tmp_path / "drawn" / "1.png")
    assert drawn.shape[2] == 3
    green = (drawn[..., 1] > 180) & (drawn[..., 0] < 120)
    assert green.sum() > 500


def test_a_drawing_that_fails_loses_no_result(run, shots, tmp_path, monkeypatch):
    monkeypatch.setattr("omnisight.report.drawings.detections.draw_residuals", raises_error(OSError("no room")))
    status, out, err = run("calibrate", shots, *QUICK, "--draw", tmp_path / "drawn", "-o", tmp_path / "c.json")
    assert (status, err) == (2, "omnisight: no room\n")
    assert "written:" in out
    assert load(tmp_path / "c.json").model.name == "equidistant"


def test_pictures_of_one_name_in_two_folders_are_told_apart(run, shots, tmp_path):
    for name, numbers in (("left", (1, 2, 3)), ("right", (4, 5, 6))):
        (tmp_path / name).mkdir()
        for i, number in enumerate(numbers):
            shutil.copy(shots / f"{number}.png", tmp_path / name / f"{i}.png")
    status, out, _ = run("calibrate", tmp_path / "left", tmp_path / "right", *QUICK, "--json")
    apart = json.loads(out)["images"]
    together = json.loads(run("calibrate", shots, *QUICK, "--json")[1])["images"]
    assert status == 0
    assert [p["corners"] for p in apart] == [p["corners"] for p in together]
    np.testing.assert_allclose([p["rms"] for p in apart], [p["rms"] for p in together], rtol=1e-6)
    run("calibrate", tmp_path / "left", tmp_path / "right", *QUICK, "--draw", tmp_path / "drawn")
    assert len(file_names(tmp_path / "drawn")) == 6


def test_a_dropped_picture_is_left_out_and_an_unknown_one_is_told_with_those_there_are(run, refuses, shots):
    status, out, _ = run("calibrate", shots, *QUICK, "--drop", "2.png", "--drop", "5.png")
    assert status == 0
    assert sorted(image_rows(out)) == [name for name in file_names(shots) if name not in ("2.png", "5.png")]
    said = refuses("calibrate", shots, *QUICK, "--drop", "nine.png")
    assert "--drop: there is no image nine.png; there are 1.png, 2.png" in said


def test_the_original_method_tells_its_steps_beside_ours_and_its_camera_is_written(run, shots, tmp_path):
    status, out, _ = run(
        *("calibrate", shots, "--pattern", "9x6", "--model", "kannala_brandt", "--method", "ocamcalib"),
        *("-o", tmp_path / "camera.json"),
    )
    assert status == 0
    figures = {line.rsplit(None, 2)[0]: float(line.split()[-2]) for line in out.splitlines() if "ocamcalib, " in line}
    assert figures["ocamcalib, refined"] <= figures["ocamcalib, centre searched"] <= figures["ocamcalib, linear steps"]
    assert "omnisight, kannala_brandt" in out
    found = load(tmp_path / "camera.json")
    assert found.model.name == "ocam"
    assert found.calibration["method"] == "ocamcalib"
    assert found.calibration["rms"] == pytest.approx(figures["ocamcalib, refined"], abs=6e-4)


def test_the_verdict_and_its_reasons_are_printed_stored_and_in_json(run, shots, tmp_path):
    few = sorted(shots.iterdir())[:3]
    status, out, _ = run("calibrate", *few, *QUICK, "-o", tmp_path / "camera.json")
    assert status == 0
    stored = load(tmp_path / "camera.json").calibration
    assert f"verdict: {stored['verdict']}" in out
    assert stored["verdict"] in ("good", "usable", "do not use")
    assert stored["reasons"]
    assert all(reason in out for reason in stored["reasons"])
    result = json.loads(run("calibrate", *few, *QUICK, "--json")[1])
    assert (result["verdict"], result["reasons"]) == (stored["verdict"], stored["reasons"])


def test_a_report_is_one_page_and_a_failing_one_loses_no_camera(run, shots, tmp_path, monkeypatch):
    page, camera = tmp_path / "report.html", tmp_path / "camera.json"
    status, out, _ = run("calibrate", shots, *QUICK, "--report", page)
    assert status == 0
    assert f"report: {page}" in out
    assert 'id="calibration"' in page.read_text(encoding="utf-8")
    monkeypatch.setattr("omnisight.report.write_report", raises_error(OSError(28, "No space left on device")))
    status, _, err = run("calibrate", shots, *QUICK, "--report", page, "-o", camera)
    assert status != 0
    assert "No space left" in err
    assert load(camera).size == SIZE


def test_a_report_that_could_not_be_written_is_refused_before_the_work(refuses, shots, tmp_path):
    assert "there is no folder" in refuses("calibrate", shots, *QUICK, "--report", tmp_path / "no" / "report.html")


@pytest.mark.parametrize("option", ["-o", "--report"])
def test_a_picture_is_never_written_over(refuses, folder, option):
    picture = folder / "1.png"
    before = picture.read_bytes()
    assert "is one of the images and would be lost" in refuses("calibrate", folder, *QUICK, option, picture)
    assert picture.read_bytes() == before


def test_camera_and_report_need_two_files(refuses, shots, tmp_path):
    one = tmp_path / "one.json"
    assert "give two files" in refuses("calibrate", shots, *QUICK, "-o", one, "--report", one)


def test_dropping_all_pictures_is_told_so(refuses, shots):
    drops = [word for name in file_names(shots) for word in ("--drop", name)]
    assert "--drop leaves no image" in refuses("calibrate", shots, *QUICK, *drops)
