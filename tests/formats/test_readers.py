"""The stated limits of other programs, measured with these programs: `formats.<name>.READERS`.

The programs that are not Python packages come from the system: `apt install python3-mrcal hugin-tools`. With
OMNISIGHT_READERS=1 a missing program is an error instead of a skipped test.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from omnisight.camera import Camera
from omnisight.formats import get_format, save
from omnisight.formats.colmap import LENSES
from omnisight.models import model_class

SYSTEM_PYTHON = "/usr/bin/python3"
# Angles from the axis, and azimuths.
AZIMUTHS = np.radians([10.0, 130.0, 250.0])
WITHIN_DEG, BEYOND_DEG = np.array([5.0, 20.0, 35.0]), np.array([95.0, 110.0])
WIDE_DEG = np.array([5.0, 35.0, 80.0, 95.0, 110.0])
MAX_ERROR_PX = 2e-3  # pano_trafo prints six decimals of angles in px, and iterates


def bearings_at(degrees):
    theta, phi = np.meshgrid(np.radians(degrees), AZIMUTHS, indexing="ij")
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1).reshape(-1, 3)


def example(name, model):
    """Return a camera that the format holds and whose coefficients are small."""
    made = model_class(model).example()
    zero = {key: 0.0 for key in made.to_dict() if key in ("skew", "k3", "k2", "p1", "p2")} if name == "hugin" else {}
    zero |= {"skew": 0.0} if "skew" in made.to_dict() else {}
    one_focal = {"fy": made.to_dict()["fx"]} if name == "hugin" and model != "equirectangular" else {}
    size = (480, 360) if model == "orthographic" else (960, 720)
    if model == "equirectangular" and name != "mrcal":
        size = (1024, 512)
        return Camera(made.with_params([1024 / (2 * np.pi), 512 / np.pi, 511.5, 255.5]), size)
    return Camera(made.with_values({**made.to_dict(), **one_focal, **zero}), size)


# -- one function per format: the pixels that its reader computes for bearings, NaN where it computes none ---------


def opencv(path, camera, bearings):
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    k, d = storage.getNode("camera_matrix").mat(), storage.getNode("distortion_coefficients").mat()
    points, zero = bearings[:, None], np.zeros(3)
    if camera.model.name == "kannala_brandt":
        return cv2.fisheye.projectPoints(points, zero, zero, k, d)[0][:, 0]
    if camera.model.name in ("mei", "unified"):
        if not hasattr(cv2, "omnidir"):
            missing("cv2.omnidir")
        return cv2.omnidir.projectPoints(points, zero, zero, k, storage.getNode("xi").real(), d)[0][:, 0]
    return cv2.projectPoints(points, zero, zero, k, d)[0][:, 0]


PYCOLMAP = """
import json, sys, numpy, pycolmap
words, bearings = json.load(sys.stdin)
camera = pycolmap.Camera(model=words[1], width=int(words[2]), height=int(words[3]), params=list(map(float, words[4:])))
print(json.dumps(numpy.asarray(camera.img_from_cam(numpy.array(bearings)), float).tolist()))
"""
MRCAL = """
import json, sys, numpy, mrcal
path, bearings = json.load(sys.stdin)
print(json.dumps(mrcal.project(numpy.array(bearings), *mrcal.cameramodel(path).intrinsics()).tolist()))
"""


def colmap(path, camera, bearings):
    (words,) = (line.split() for line in path.read_text().splitlines() if line[0] != "#")
    assert words[1] in LENSES
    # In a process of its own: pycolmap and numba in one crash here.
    return ask(sys.executable, "pycolmap", PYCOLMAP, [words, bearings.tolist()]) - 0.5


def mrcal(path, camera, bearings):
    return ask(SYSTEM_PYTHON, "mrcal", MRCAL, [str(path), bearings.tolist()])


def hugin(path, camera, bearings):
    if shutil.which("pano_trafo") is None:
        missing("pano_trafo")
    # The project's panorama is 3000 px wide.
    lon, lat = np.arctan2(bearings[:, 0], bearings[:, 2]), np.arcsin(bearings[:, 1])
    panorama = np.stack([lon, lat], -1) * 1500 / np.pi + [1499.5, 749.5]
    text = "\n".join(f"{u:.9f} {v:.9f}" for u, v in panorama) + "\n"
    done = subprocess.run(
        ["pano_trafo", "-r", str(path), "0"], input=text, capture_output=True, text=True, check=True, timeout=60
    )
    pixels = np.array([line.split() for line in done.stdout.splitlines()], float)
    return np.where((pixels == -1).all(1, keepdims=True), np.nan, pixels)


def ask(python, package, program, question):
    """Return what a program of another Python prints, or skip without its package."""
    found = (
        Path(python).exists()
        and subprocess.run([python, "-c", f"import {package}"], capture_output=True).returncode == 0
    )
    if not found:
        missing(package)
    done = subprocess.run(
        [python, "-c", program], input=json.dumps(question), capture_output=True, text=True, check=True, timeout=60
    )
    return np.array(json.loads(done.stdout), float)


def missing(what):
    if os.environ.get("OMNISIGHT_READERS"):
        pytest.fail(f"{what} is not installed")
    pytest.skip(f"needs {what}")


READERS = {"opencv": opencv, "colmap": colmap, "mrcal": mrcal, "hugin": hugin}
SLOW_OR_FOREIGN = {"colmap", "mrcal", "hugin"}
CASES = [
    pytest.param(name, model, marks=[pytest.mark.peer] * (name in SLOW_OR_FOREIGN or model in ("mei", "unified")))
    for name in READERS
    for model in get_format(name).MODELS
]


@pytest.mark.parametrize(("name", "model"), CASES)
def test_reader_is_exact_up_to_its_stated_limit_and_not_beyond(name, model, tmp_path):
    camera = example(name, model)
    path = tmp_path / f"camera{get_format(name).SUFFIX}"
    save(camera, path, format=name)
    reader = get_format(name).READERS[model]
    unlimited = reader.theta_max_deg == 180
    within = bearings_at(WIDE_DEG if unlimited else WITHIN_DEG)
    pixels, valid = camera.project(within)
    valid &= camera.in_image(pixels)
    assert valid.sum() >= 2
    np.testing.assert_allclose(READERS[name](path, camera, within)[valid], pixels[valid], atol=MAX_ERROR_PX)
    if not unlimited:
        beyond = bearings_at(BEYOND_DEG)
        found, ours = READERS[name](path, camera, beyond), camera.project(beyond)[0]
        same = np.linalg.norm(found - ours, axis=1) < 1
        # COLMAP projects its division model, but unprojects it to the opposite direction.
        assert not same.any() or (name, model) == ("colmap", "division")


def test_cv2_fisheye_unprojects_only_up_to_the_stated_angle():
    camera = Camera(model_class("kannala_brandt")(300.0, 300.0, 640.0, 480.0, 0.01, 0.002, 0.0, 0.0), (1280, 960))
    limit = get_format("opencv").READERS["kannala_brandt"].limit_deg(camera.model)
    assert limit == pytest.approx(87.1, abs=0.1)
    k, d = np.array([[300.0, 0, 640], [0, 300, 480], [0, 0, 1]]), np.array([0.01, 0.002, 0, 0])
    for degrees, right in ((limit - 0.1, True), (limit + 0.5, False), (110.0, False)):
        pixels = camera.project(bearings_at([degrees]))[0]
        x, y = cv2.fisheye.undistortPoints(pixels[:, None], k, d)[:, 0].T
        theta = np.degrees(np.arctan(np.hypot(x, y)))
        assert (np.abs(theta - degrees) < 1e-3).all() == right, degrees


@pytest.mark.parametrize(
    ("name", "model", "degrees", "text"),
    [
        ("opencv", "kannala_brandt", 60, "right up to 87.1 degrees off-axis, this camera reaches 60.0 degrees"),
        ("opencv", "kannala_brandt", 120, "Do not use it there: this camera reaches 120.0 degrees"),
        ("colmap", "kannala_brandt", 120, "right up to 90 degrees off-axis; beyond, it returns no pixel"),
        ("kalibr", "kannala_brandt", 120, "was measured; check points past 90 degrees, this camera reaches 120.0"),
    ],
)
def test_export_states_the_limit_of_its_reader_in_the_file_and_in_its_notes(name, model, degrees, text, tmp_path):
    bearing = np.radians(degrees)
    lens = model_class(model)(300.0, 300.0, 640.0, 480.0, 0.01, 0.002, 0.0, 0.0)
    camera = Camera(lens, (1280, 960), theta_max=bearing)
    written = save(camera, tmp_path / "camera", format=name)
    (note,) = (note for note in written.notes if note.startswith("reader:"))
    reached = np.degrees(np.arccos(camera.samples()[0][:, 2].min()))
    assert text.replace(f"{degrees:.1f}", f"{reached:.1f}") in note
    assert (tmp_path / "camera").read_text().rstrip().endswith(f"# {note}")


def test_native_file_needs_no_note(tmp_path):
    camera = example("native", "kannala_brandt")
    assert not [note for note in save(camera, tmp_path / "camera.json").notes if "reader" in note]


@pytest.mark.parametrize("key", ["rt_cam_ref", "extrinsics"])
def test_mrcal_pose_is_written_under_the_name_that_every_release_reads(key, tmp_path):
    camera = example("mrcal", "rational")
    pose = [0.1, 0.2, 0.3, 1.0, 2.0, 3.0]
    save(Camera(camera.model, camera.size, extra={key: pose}), tmp_path / "camera.cameramodel", format="mrcal")
    text = (tmp_path / "camera.cameramodel").read_text()
    assert f"'extrinsics': {pose}" in text
    assert "rt_cam_ref" not in text
