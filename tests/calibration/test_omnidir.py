"""The model of Mei against cv2.omnidir: projection, files and optimum."""

import numpy as np
import pytest

from calibrating import calibrate, observe
from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.initial_camera import estimate_initial_camera
from omnisight.calibration.multistart import model_starts
from omnisight.calibration.resection import resect
from omnisight.camera import Camera
from omnisight.formats import load, save
from omnisight.models import model_class
from omnisight.models.mei import Mei
from omnisight.targets import Checkerboard

CAMERAS = {
    "lens": Mei(478.0, 476.0, 512.3, 383.1, 1.07, -0.11, 0.03, 3e-4, -2e-4, 0.4),
    "parabola": Mei(302.0, 303.0, 642.0, 521.0, 1.0, 0.0, 0.0, 0.0, 0.0),
    "hyperbola": Mei(250.0, 251.0, 320.0, 240.0, 0.8, 0.02, 1e-3, -1e-4, 4e-4, -0.3),
    "pinhole": Mei(640.0, 641.0, 320.0, 240.0, 0.0, -0.2, 0.05, 1e-3, 2e-3),
    "far": Mei(2100.0, 2110.0, 954.0, 955.0, 2.2, 0.4, 0.2, 1e-4, 1e-4),
}


@pytest.fixture(scope="module")
def cv2():
    found = pytest.importorskip("cv2")
    if not hasattr(found, "omnidir"):
        pytest.skip("needs cv2.omnidir, which opencv-contrib-python-headless has")
    return found


def directions(model, seed=0, count=500):
    """Return points over the domain of the model, and their pixels."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(20 * count, 3)) * rng.uniform(0.3, 30, (20 * count, 1))
    pixels, valid = model.project(points)
    return points[valid][:count], pixels[valid][:count]


def as_opencv(model):
    k = np.array([[model.fx, model.skew, model.cx], [0, model.fy, model.cy], [0, 0, 1]])
    return k, model.xi, np.array([model.k1, model.k2, model.p1, model.p2])


def project_opencv(cv2, points, k, xi, d):
    pixels, _ = cv2.omnidir.projectPoints(points[:, None], np.zeros(3), np.zeros(3), k, float(xi), d)
    return pixels[:, 0]


@pytest.mark.peer
@pytest.mark.parametrize("name", CAMERAS)
def test_mei_projects_as_omnidir(cv2, name):
    model = CAMERAS[name]
    points, pixels = directions(model)
    assert name == "pinhole" or (points[:, 2] < 0).any()
    np.testing.assert_allclose(
        pixels, project_opencv(cv2, points, *as_opencv(model)), rtol=0, atol=1e-9 * np.abs(pixels).max()
    )


@pytest.mark.peer
@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
def test_file_of_opencv_gives_the_same_rays(cv2, tmp_path, name, suffix):
    model = CAMERAS[name]
    k, xi, d = as_opencv(model)
    path = tmp_path / f"omnidir.{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for key, value in {"camera_matrix": k, "xi": np.array([[xi]]), "distortion_coefficients": d[None]}.items():
        storage.write(key, value)
    for key, value in {"image_width": 1280, "image_height": 1024}.items():
        storage.write(key, value)
    storage.release()
    camera = load(path)
    points, pixels = directions(model)
    bearings, valid = camera.unproject(pixels)
    assert valid.all()
    along = points / np.linalg.norm(points, axis=1, keepdims=True)
    assert np.linalg.norm(np.cross(bearings, along), axis=1).max() < 1e-9
    assert (np.einsum("ni,ni->n", bearings, along) > 0).all()
    assert camera.size == (1280, 1024)


@pytest.mark.peer
@pytest.mark.parametrize("name", CAMERAS)
def test_opencv_reads_our_file_and_projects_equally(cv2, tmp_path, name):
    model = CAMERAS[name]
    path = tmp_path / "camera.yml"
    save(Camera(model, (1280, 1024)), path, format="opencv")
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    k, d = (storage.getNode(key).mat() for key in ("camera_matrix", "distortion_coefficients"))
    points, pixels = directions(model)
    found = project_opencv(cv2, points, k, storage.getNode("xi").real(), d.ravel())
    np.testing.assert_allclose(found, pixels, rtol=0, atol=1e-9 * np.abs(pixels).max())


SIZES = {
    "kaidan": (640, 480),
    "mei": (1280, 1024),
    "ai360_a": (1920, 1920),
    "fish1": (1032, 778),
    "fstereo_right": (960, 600),
}


def corners(data, name):
    with np.load(data("corners") / f"{name}.npz") as stored:
        board = Checkerboard(*(int(n) for n in stored["pattern"]))
        return observe([(board.points, pixels) for pixels in stored["corners"].astype(float)], SIZES[name])


def least_squares(initial, views):
    """Minimize what OpenCV minimizes: equal weights, and the skew is free."""
    ((_, start),) = model_starts("mei", initial, views)
    state = refine(start, views, free_parameters=FreeParameters.of(start.model, free=("skew",)), loss="squared").state
    return state, float(np.sqrt((state.lengths(views) ** 2).mean()))


@pytest.mark.peer
@pytest.mark.slow
@pytest.mark.parametrize("name", SIZES)
def test_least_squares_optimum_is_not_above_that_of_omnidir(cv2, data, name):
    views, size = corners(data, name), SIZES[name]
    objects, images = ([x[g][None] for g in views.groups] for x in (views.points, views.pixels))
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 1000, 1e-12)
    rms, *_, kept = cv2.omnidir.calibrate(objects, images, size, None, None, None, 0, criteria)
    if kept.size == len(views):
        state, ours = least_squares(estimate_initial_camera(views), views)
        assert len(state.rotations) == len(views)
    else:
        used = views.subset(kept.ravel())
        _, ours = least_squares(estimate_initial_camera(used), used)
    # Both stop at a relative decrease of about 1e-8.
    assert ours <= rms * (1 + 1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mei", "kaidan"])
def test_calibration_of_a_mirror_reaches_the_least_squares_optimum(data, name):
    views = corners(data, name)
    _, least = least_squares(estimate_initial_camera(views), views)
    # A start with a parabolic mirror of another focal length, centred in the image, reaches the same optimum.
    centre = (np.array(SIZES[name]) - 1) / 2
    parabola = Mei(0.3 * centre[0] * 2, 0.3 * centre[0] * 2, *centre, 1.0, 0.0, 0.0, 0.0, 0.0)
    _, rms = least_squares(resect(parabola, views), views)
    assert rms == pytest.approx(least, rel=1e-6)
    calibration = calibrate(views, model="mei", loss="squared", free=("skew",), flat=True)
    assert calibration.rms == pytest.approx(least, rel=1e-6)


def test_spherical_mirror_is_calibrated_as_mei():
    # A sphere under an orthographic camera: the ray at theta is reflected where the normal is at theta/2, so r = R
    # sin(theta/2). The scene is distant, so the camera is nearly central; xi and the distortion approximate it.
    sphere = model_class("equisolid").from_dict({"fx": 225.0, "fy": 225.0, "cx": 641.0, "cy": 519.0})
    board, rng = Checkerboard(8, 6), np.random.default_rng(0)
    boards = []
    for i in range(12):
        theta, phi = np.radians(10 + 7 * i), 2.4 * i
        towards = np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
        side = np.cross([0.0, 0.6, 0.8], towards)
        side /= np.linalg.norm(side)
        tilted = np.cross(towards, side) + 0.5 * towards
        rotation = np.stack([side, tilted / np.linalg.norm(tilted)])
        pixels, valid = sphere.project((board.points[:, :2] - (3.5, 2.5)) @ rotation + 9 * towards)
        assert valid.all()
        boards.append((board.points, pixels + rng.normal(0, 0.1, pixels.shape)))
    views = observe(boards, (1280, 1024))
    state, rms = least_squares(estimate_initial_camera(views), views)
    assert rms < 1.1 * 0.1 * np.sqrt(2)
    assert state.model.xi > 0
