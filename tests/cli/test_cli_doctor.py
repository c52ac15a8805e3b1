"""omnisight doctor, of a recording and of the installation."""

import json

import cv2
import numpy as np
import pytest

import omnisight as om
from omnisight.pipeline.odometry import doctor


@pytest.fixture
def still(tmp_path):
    """Return a folder of panoramas from one place."""
    rng = np.random.default_rng(0)
    image = cv2.GaussianBlur(rng.integers(0, 255, (128, 256)).astype(np.uint8), (0, 0), 1.5)
    folder = tmp_path / "still"
    folder.mkdir()
    for k in range(4):
        om.write_image(folder / f"{k}.png", image)
    return folder


def test_the_installation_of_the_tests_is_all_right(run):
    status, out, err = run("doctor")
    assert (status, err) == (0, "")
    assert [line.split()[0] for line in out.splitlines() if not line.startswith(" ")] == [
        *("versions", "OpenCV", "threads", "cache", "permissions", "extras", "video")
    ]
    assert om.__version__ in out
    assert cv2.__version__ in out


def test_wheels_of_opencv_that_overwrite_each_other_fail(run, monkeypatch):
    owners = {"cv2": ["opencv-python", "opencv-python-headless"]}
    monkeypatch.setattr("importlib.metadata.packages_distributions", lambda: owners)
    status, out, _ = run("doctor", "--json")
    assert status == 2
    data = json.loads(out)
    assert data["level"] == "failed"
    (finding,) = (finding for finding in data["findings"] if finding["level"] == "failed")
    assert "pip uninstall -y opencv-python opencv-python-headless" in finding["advice"]


def test_a_cache_that_cannot_be_written_and_a_wrong_number_of_threads_are_warnings(run, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("OMNISIGHT_CACHE", str(tmp_path / "file" / "cache"))
    monkeypatch.setenv("OMNISIGHT_THREADS", "many")
    status, out, _ = run("doctor")
    assert status == 0
    assert "set OMNISIGHT_CACHE to a folder that can be written" in out
    assert "OMNISIGHT_THREADS is no number" in out


def test_images_from_one_place_fail(run, still):
    status, out, err = run("doctor", still)
    assert (status, err) == (2, "")
    rows = {line[:15].strip(): line for line in out.splitlines() if not line.startswith(" ")}
    assert "failed" in rows["motion"]
    assert "warning" in rows["duplicates"]
    assert "360° field of view" in rows["calibration"]
    data = json.loads(run("doctor", still, "--json", "--write-mask", "mask.png")[1])
    assert len(data["findings"]) == 11
    assert data["mask"] is None


def test_wrong_input_is_refused(run, refuses, tmp_path, still):
    assert "--images must be at least 8" in refuses("doctor", still, "--images", "3")
    assert "missing" in refuses("doctor", tmp_path / "missing")
    assert "is a folder" in refuses("doctor", still, "--write-mask", tmp_path)


def test_a_mask_does_not_replace_an_image(refuses, still):
    before = (still / "1.png").read_bytes()
    assert "is one of the inputs" in refuses("doctor", still, "--write-mask", still / "1.png")
    assert "contains the images" in refuses("doctor", still, "--write-mask", still / "mask.png")
    assert (still / "1.png").read_bytes() == before


def test_a_mask_without_a_usable_pixel_is_refused(run, still, tmp_path):
    om.write_image(tmp_path / "mask.png", np.ones((128, 256), np.uint8))
    status, _, err = run("doctor", still, "--mask", tmp_path / "mask.png")
    assert status == 2
    assert "the mask selects no pixel" in err


def test_few_images_are_those_of_the_beginning_and_the_end():
    assert list(doctor._spread(1000, 8)) == [*range(8), *range(992, 1000)]
    assert list(doctor._spread(12, 8)) == list(range(12))
