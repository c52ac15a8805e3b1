"""Checks of recordings that have one defect each."""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

import omnisight as om
from omnisight.diagnosis.edge_blur import edge_blur
from omnisight.diagnosis.finding import Level


def findings(folder, camera, **options):
    diagnosis = om.doctor(folder, camera, om.DoctorOptions(fps=10, **options))
    return {finding.name: finding for finding in diagnosis.findings}, diagnosis


def test_a_good_recording_has_no_warning(walk):
    found, diagnosis = findings(walk.folder / "images", walk.camera)
    assert len(found) == 11
    assert diagnosis
    assert {name for name, finding in found.items() if finding.level > Level.OK} == {"rolling shutter"}
    assert "190° field of view" in found["calibration"].figure
    assert "32 examined" in found["images"].figure
    assert "must turn faster" in found["rolling shutter"].figure


def test_without_a_camera_only_calibration_fails_and_what_needs_it_is_unknown(walk):
    found, diagnosis = findings(walk.folder / "images", None)
    assert not diagnosis
    assert [name for name, finding in found.items() if finding.level == Level.FAILED] == ["calibration"]
    assert {name for name, f in found.items() if f.level == Level.UNKNOWN} == {
        "cuts",
        "texture",
        "rolling shutter",
        "motion",
    }
    assert "omnisight calibrate" in found["calibration"].advice


def test_a_camera_of_another_size_is_reported(walk):
    found, _ = findings(walk.folder / "images", om.fisheye(300, 300))
    assert found["calibration"].level == Level.FAILED
    assert "400x300" in found["calibration"].figure.replace(" ", "")


@pytest.mark.parametrize("factor", [0.9, 1.05])
def test_a_camera_of_another_focal_length_is_reported(walk, factor):
    model = walk.camera.model
    other = replace(walk.camera, model=replace(model, fx=factor * model.fx, fy=factor * model.fy))
    finding = findings(walk.folder / "images", other)[0]["calibration"]
    assert finding.level == Level.WARNING
    assert "does the file belong to this camera" in finding.advice
    percent, sigma, direction = re.search(r"length ([\d.]+)% ± ([\d.]+)% (\w+)", finding.figure).groups()
    change = float(percent) * (1 if direction == "longer" else -1)
    assert change == pytest.approx(100 * (1 / factor - 1), abs=4 * float(sigma))


def test_a_rolling_shutter_is_measured(rolling):
    found, _ = findings(rolling.folder / "images", rolling.camera)
    finding = found["rolling shutter"]
    assert finding.level == Level.WARNING
    milliseconds, sigma = float(finding.figure.split()[1]), float(finding.figure.split()[3])
    assert milliseconds == pytest.approx(40, abs=max(4 * sigma, 4))


def test_a_camera_that_does_not_move_is_reported(walk, tmp_path):
    rng = np.random.default_rng(0)
    noisy = [
        np.clip(walk.images[0] + rng.normal(0, 2, walk.images[0].shape), 0, 255).astype(np.uint8) for _ in range(10)
    ]
    found, diagnosis = findings(walk.write(tmp_path / "still", noisy), walk.camera)
    assert not diagnosis
    assert found["motion"].level == Level.FAILED
    assert found["duplicates"].level == Level.OK
    assert found["static regions"].level == Level.UNKNOWN


def test_repeated_images_are_reported(walk, tmp_path):
    found, _ = findings(
        walk.write(tmp_path / "twice", [image for image in walk.images[:8] for _ in range(2)]), walk.camera
    )
    assert found["duplicates"].level == Level.WARNING
    assert "8 of 15 images" in found["duplicates"].figure


def test_a_cut_is_reported(walk, tmp_path):
    images = [*walk.images[:9], *(image[:, ::-1] for image in walk.images[20:29])]
    found, _ = findings(walk.write(tmp_path / "cut", images), walk.camera)
    assert found["cuts"].level == Level.WARNING
    assert "1 of " in found["cuts"].figure
    assert "image 9" in found["cuts"].figure


def test_dark_saturated_and_covered_images_are_reported(walk, tmp_path):
    dark = findings(walk.write(tmp_path / "dark", [image // 12 for image in walk.images[:9]]), walk.camera)[0]
    assert "too dark" in dark["exposure"].advice
    bright = [np.clip(2.6 * image.astype(float), 0, 255).astype(np.uint8) for image in walk.images[:9]]
    assert "too bright" in findings(walk.write(tmp_path / "bright", bright), walk.camera)[0]["exposure"].advice
    covered = [image // 40 if k in (4, 5) else image for k, image in enumerate(walk.images[:12])]
    assert "images 4, 5" in findings(walk.write(tmp_path / "cover", covered), walk.camera)[0]["exposure"].advice


def test_blur_of_the_lens_and_of_the_motion_are_told_apart(walk, tmp_path):
    soft = [cv2.GaussianBlur(image, (0, 0), 3.0) for image in walk.images[:9]]
    assert "focus" in findings(walk.write(tmp_path / "soft", soft), walk.camera)[0]["blur"].advice
    kernel = np.zeros((15, 15), np.float32)
    kernel[7] = 1 / 15
    moving = [cv2.filter2D(image, -1, kernel) if k % 3 == 0 else image for k, image in enumerate(walk.images[:12])]
    found = findings(walk.write(tmp_path / "moving", moving), walk.camera)[0]["blur"]
    assert "4 of 12 images are blurred by motion" in found.figure


def test_a_static_region_is_found_and_masked(walk, tmp_path):
    rng = np.random.default_rng(1)
    hood = cv2.GaussianBlur(rng.integers(0, 255, (60, 120, 3)).astype(np.uint8), (0, 0), 2.0) // 2 + 60
    images = [image.copy() for image in walk.images]
    for image in images:
        image[200:260, 140:260] = hood
    folder = walk.write(tmp_path / "hood", images)
    found, diagnosis = findings(folder, walk.camera)
    assert found["static regions"].level == Level.WARNING
    truth = np.zeros((300, 400), bool)
    truth[200:260, 140:260] = True
    region = diagnosis.static_region
    assert (region & truth).sum() > 0.85 * truth.sum()
    assert (region & ~cv2.dilate(truth.astype(np.uint8), np.ones((31, 31))).astype(bool)).sum() < 0.01 * truth.size
    om.write_image(tmp_path / "mask.png", np.where(region, 0, 255).astype(np.uint8))
    assert findings(folder, walk.camera, mask=tmp_path / "mask.png")[0]["static regions"].level == Level.OK


def test_images_without_texture_fail(walk, tmp_path):
    flat = [np.full_like(image, 120) for image in walk.images[:4]]
    found, diagnosis = findings(walk.write(tmp_path / "flat", flat), walk.camera)
    assert not diagnosis
    assert found["texture"].level == Level.FAILED


@pytest.mark.parametrize("sigma", [0.8, 1.5, 2.5])
def test_the_blur_of_edges_is_their_width(sigma):
    image = np.full((300, 300), 40, np.float32)
    for k in range(6):
        cv2.rectangle(image, (20 + 45 * k, 20), (45 + 45 * k, 280), 200.0, -1)
        cv2.rectangle(image, (0, 20 + 45 * k), (300, 30 + 45 * k), 120.0, -1)
    blurred = cv2.GaussianBlur(image, (0, 0), sigma).astype(np.uint8)
    assert edge_blur(blurred, np.ones((300, 300), bool)) == pytest.approx(sigma, rel=0.2)
