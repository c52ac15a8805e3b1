"""Formats against what others compute: pycolmap, OpenCV, and files that other tools wrote."""

import importlib.util
import json
import subprocess
import sys

import cv2
import numpy as np
import pytest

from omnisight.camera import Camera
from omnisight.formats import get_format, load, save
from omnisight.formats.colmap import LENSES
from omnisight.models import model_class

POINTS = np.random.default_rng(1).uniform((-0.6, -0.6, 1), (0.6, 0.6, 1.2), (40, 3))
COLMAP_VALUES = {
    "f": 400.0, "fx": 400.0, "fy": 410.0, "cx": 320.0, "cy": 250.0, "k": -0.1, "omega": 0.9, "alpha": 0.6, "beta": 1.1,
    "k1": 0.03, "k2": -0.011, "k3": 0.0021, "k4": -0.0002, "k5": 2e-5, "k6": -3e-6, "p1": 3e-4, "p2": -5e-4,
    "s1": 4e-4, "s2": -3e-5, "s3": -2e-4, "s4": 2e-5, "width": 640.0, "height": 480.0,
}  # fmt: skip
# In a process of its own: pycolmap and numba in one crash here.
PROJECT_BY_PYCOLMAP = """
import json, sys, numpy, pycolmap
points, cameras = json.load(sys.stdin)
def ask(name, params):
    camera = pycolmap.Camera(model=name, width=640, height=480, params=params)
    return numpy.asarray(camera.img_from_cam(numpy.array(points))).tolist()
print(json.dumps([ask(*camera) for camera in cameras]))
"""


@pytest.mark.peer
def test_colmap_every_model_projects_as_pycolmap_does(tmp_path):
    if importlib.util.find_spec("pycolmap") is None:
        pytest.skip("needs pycolmap")
    cameras = [(name, [COLMAP_VALUES[key] for key in keys]) for name, (_, keys) in LENSES.items()]
    completed = subprocess.run(
        [sys.executable, "-c", PROJECT_BY_PYCOLMAP],
        input=json.dumps([POINTS.tolist(), cameras]),
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    for (name, values), expected in zip(cameras, json.loads(completed.stdout), strict=True):
        (tmp_path / "cameras.txt").write_text(f"1 {name} 640 480 {' '.join(map(repr, values))}\n")
        projected, valid = load(tmp_path / "cameras.txt").project(POINTS)
        assert valid.all(), name
        assert projected + 0.5 == pytest.approx(np.array(expected), abs=1e-9), name


def opencv_pixels(camera):
    """Project by OpenCV itself."""
    m, p = camera.model, camera.model.to_dict()
    k = np.array([[m.fx, p.get("skew", 0.0), m.cx], [0, m.fy, m.cy], [0, 0, 1.0]])
    zero = np.zeros(3)
    points = POINTS[:, None]
    if m.name == "kannala_brandt":
        d = np.array([m.k1, m.k2, m.k3, m.k4])
        return k, d, cv2.fisheye.projectPoints(points, zero, zero, k, d)[0]
    if m.name in OMNIDIR:
        if not hasattr(cv2, "omnidir"):
            pytest.skip("needs cv2.omnidir")
        d = np.array([p.get(name, 0.0) for name in ("k1", "k2", "p1", "p2")])
        return k, d, cv2.omnidir.projectPoints(points, zero, zero, k, m.xi, d)[0]
    names = {"rational": "k1 k2 p1 p2 k3 k4 k5 k6", "radial_tangential": "k1 k2 p1 p2 k3", "pinhole": ""}[m.name]
    d = np.array([p[name] for name in names.split()])
    return k, d, cv2.projectPoints(points, zero, zero, k, d if d.size else np.zeros(5))[0]


OMNIDIR = {"mei", "unified"}
OPENCV = [
    pytest.param(m, marks=[pytest.mark.peer] * (m in OMNIDIR)) for m in get_format("opencv").MODELS if m != "pinhole"
]


@pytest.mark.parametrize("model", OPENCV)
@pytest.mark.parametrize("kind", ["yml", "xml", "json"])
def test_files_written_by_opencv_are_read(model, kind, tmp_path):
    camera = Camera(model_class(model).example(), (960, 720))
    k, d, pixels = opencv_pixels(camera)
    storage = cv2.FileStorage(str(tmp_path / f"camera.{kind}"), cv2.FILE_STORAGE_WRITE)
    storage.write("calibration_time", 'Mon "3" & <x>')
    storage.write("image_width", 960)
    storage.write("image_height", 720)
    storage.write("image_points", np.arange(48.0).reshape(2, 12, 2))
    storage.write("camera_matrix", k)
    storage.write("distortion_coefficients", d.reshape(1, -1))
    storage.writeComment("a comment: [")
    if model in OMNIDIR:
        storage.write("xi", np.array([[camera.model.xi]]))
    else:
        storage.write("fisheye_model", int(model == "kannala_brandt"))
    storage.write("errors", np.array([np.nan, 1.0, -np.inf]))
    storage.release()
    again = load(tmp_path / f"camera.{kind}")
    assert again.size == (960, 720)
    assert again.model == camera.model
    assert again.extra["calibration_time"].startswith("Mon")
    assert len(again.extra["image_points"]["data"]) == 48
    projected, valid = again.project(POINTS)
    assert projected[valid] == pytest.approx(pixels[:, 0][valid], abs=1e-6)
    assert valid.sum() > 30


@pytest.mark.parametrize("model", get_format("opencv").MODELS)
def test_opencv_reads_written_files(model, tmp_path):
    camera = Camera(model_class(model).example(), (960, 720))
    save(camera, tmp_path / "camera.yml", format="opencv")
    storage = cv2.FileStorage(str(tmp_path / "camera.yml"), cv2.FILE_STORAGE_READ)
    k = storage.getNode("camera_matrix").mat()
    assert (k[0, 0], k[1, 2]) == (camera.model.fx, camera.model.cy)
    count = {"kannala_brandt": 4, "mei": 4, "unified": 4, "rational": 8}.get(model, 5)
    assert storage.getNode("distortion_coefficients").mat().shape == (1, count)
    assert storage.getNode("image_width").real() == 960
    if hasattr(camera.model, "xi"):
        assert storage.getNode("xi").real() == camera.model.xi


def inverse_error(path):
    """Return the largest distance (px) between an OCamCalib file's inverse polynomial and the camera's projection."""
    rows = [line.split() for line in path.read_text().splitlines() if line.strip() and line[0] != "#"]
    camera = load(path)
    m = camera.model
    bearings, pixels = camera.samples()
    x, y, z = bearings[:, 1], bearings[:, 0], -bearings[:, 2]
    norm = np.maximum(np.hypot(x, y), 1e-300)
    rho = np.polynomial.polynomial.polyval(np.arctan2(z, norm), [float(word) for word in rows[1][1:]])
    x, y = x / norm * rho, y / norm * rho
    projected = np.stack([x * m.e + y + m.cx, x * m.c + y * m.d + m.cy], -1)
    return np.linalg.norm(projected - pixels, axis=1).max()


REAL = {
    "ai360_lens_a/calib_results.txt": (1920, 1920),
    "with_calibration/ocam_matsuren/calib_results_0.txt": (1600, 1600),
    "with_calibration/ocam_test_fisheye/calib_results_fisheye.txt": (1024, 768),
}


@pytest.mark.parametrize("name", REAL)
def test_ocamcalib_real_files_agree_with_their_own_inverse_polynomial(name, data, tmp_path):
    folder, _, rest = name.partition("/")
    camera = load(data(folder) / rest)
    assert camera.size == REAL[name]
    assert camera.extra == {}
    assert inverse_error(data(folder) / rest) < 0.05
    assert save(camera, tmp_path / "again.txt", format="ocamcalib").error_px < 1e-9
    # Written again, the inverse polynomial is as good as it is meant to be.
    assert inverse_error(tmp_path / "again.txt") < 0.02


def test_the_files_of_fisheye_calib_adapter_describe_one_camera(data):
    """Kalibr's calibrations of one data set in several models, and OCamCalib's of the same camera, agree."""
    folder = data("with_calibration") / "fisheye_calib_adapter/dataset"
    kalibr = {name: load(folder / f"kalibr/{name}.yml") for name in ("KB", "DS", "EUCM", "RadTan")}
    assert [camera.model.name for camera in kalibr.values()] == [
        "kannala_brandt", "double_sphere", "eucm", "radial_tangential",
    ]  # fmt: skip
    bearings, pixels = kalibr["KB"].samples(np.radians(35))
    for name, camera in kalibr.items():
        assert np.linalg.norm(camera.project(bearings)[0] - pixels, axis=1).max() < 1.5, name
    ocam = load(folder / "OcamCalib/OcamCalib.yml")
    assert ocam.model.name == "ocam"
    projection = [287.968301, 140.087942, -12.679484, 29.016357, 3.937199, 0.391479, 12.889536, -0.943428, -7.307169]
    projection += [1.284518, 3.303587, 0.812912]
    bearings, pixels = ocam.samples(np.radians(80))
    norm = np.maximum(np.hypot(bearings[:, 0], bearings[:, 1]), 1e-300)
    theta = np.arctan2(-bearings[:, 2], norm)
    rho = np.polynomial.polynomial.polyval(theta, projection)
    x, y = bearings[:, 0] / norm * rho, bearings[:, 1] / norm * rho
    expected = np.stack([0.998870 * x - 0.000169 * y + 359.829671, 0.000110 * x + y + 243.611488], -1)
    assert np.linalg.norm(expected - pixels, axis=1).max() < 0.3
    with pytest.raises(ValueError, match=r"alpha.*below 1, got 1\.01674"):
        load(folder / "UCM.yml")
