"""Formats of fisheye tools, on values that their documents and examples quote, against the formulas they state."""

import contextlib
import io
import json
import struct

import cv2
import numpy as np
import pytest

from omnisight.camera import Camera
from omnisight.formats import FormatError, load, load_all, save
from omnisight.models import model_class

RNG = np.random.default_rng(4)
POINTS = np.stack([*RNG.uniform(-1, 1, (2, 50)), RNG.uniform(-0.2, 1, 50)], -1)


def opencv_fisheye(k, d, points=POINTS):
    ahead = points[points[:, 2] > 0.1]
    return ahead, cv2.fisheye.projectPoints(ahead[:, None], np.zeros(3), np.zeros(3), np.array(k), np.array(d))[0][:, 0]


# -- WoodScape --------------------------------------------------------------------------------------------------

WOODSCAPE = {
    "extrinsic": {"quaternion": [0.594, -0.588, 0.387, -0.389], "translation": [3.7484, 0.0, 0.66]},
    "intrinsic": {
        "aspect_ratio": 1.01,
        "cx_offset": 3.942,
        "cy_offset": -3.093,
        "height": 966.0,
        "width": 1280.0,
        "k1": 339.749,
        "k2": -31.988,
        "k3": 48.275,
        "k4": -7.201,
        "model": "radial_poly",
        "poly_order": 4,
    },
    "name": "FV",
}


def woodscape(points, intrinsic):
    """Project by the lines of calibration_readme.txt."""
    chi = np.hypot(points[:, 0], points[:, 1])
    theta = np.arctan2(chi, points[:, 2])
    rho = sum(intrinsic[f"k{i}"] * theta**i for i in (1, 2, 3, 4))
    u = rho * points[:, 0] / chi + intrinsic["cx_offset"] + intrinsic["width"] / 2 - 0.5
    v = rho * points[:, 1] / chi * intrinsic["aspect_ratio"] + intrinsic["cy_offset"] + intrinsic["height"] / 2 - 0.5
    return np.stack([u, v], -1)


def test_woodscape_projects_like_its_readme(load_text):
    camera = load_text(json.dumps(WOODSCAPE))
    assert camera.size == (1280, 966)
    assert camera.project(POINTS)[0] == pytest.approx(woodscape(POINTS, WOODSCAPE["intrinsic"]), abs=1e-9)
    assert camera.extra["extrinsic"] == WOODSCAPE["extrinsic"]


def test_woodscape_real_file(data, tmp_path):
    path = data("with_calibration") / "woodscape_front/front.json"
    camera, given = load(path), json.loads(path.read_text())
    assert camera.project(POINTS)[0] == pytest.approx(woodscape(POINTS, given["intrinsic"]), abs=1e-9)
    written = save(camera, tmp_path / "again.json", format="woodscape")
    assert written.error_px < 1e-9
    assert [note for note in written.notes if not note.startswith("reader:")] == []
    assert json.loads((tmp_path / "again.json").read_text())["extrinsic"] == given["extrinsic"]


def test_woodscape_of_another_order_is_refused(load_text):
    with pytest.raises(FormatError, match="poly_order must be 4, got 5"):
        load_text(json.dumps(WOODSCAPE).replace('"poly_order": 4', '"poly_order": 5'))


# -- ORB-SLAM3: the numbers of its Examples/Stereo/TUM-VI.yaml -------------------------------------------------------

TUM_VI = """%YAML:1.0

File.version: "1.0"
Camera.type: "KannalaBrandt8"
Camera1.fx: 190.97847715128717
Camera1.fy: 190.9733070521226
Camera1.cx: 254.93170605935475
Camera1.cy: 256.8974428996504
Camera1.k1: 0.0034823894022493434
Camera1.k2: 0.0007150348452162257
Camera1.k3: -0.0020532361418706202
Camera1.k4: 0.00020293673591811182
Camera2.fx: 190.44236969414825
Camera2.fy: 190.4344384721956
Camera2.cx: 252.59949716835982
Camera2.cy: 254.91723064636983
Camera2.k1: 0.0034003170790442797
Camera2.k2: 0.001766278153469831
Camera2.k3: -0.00266312569781606
Camera2.k4: 0.0003299517423931039
Stereo.T_c1_c2: !!opencv-matrix
  rows: 4
  cols: 4
  dt: f
  data: [ 1.0, 0.0, 0.0, 0.101, 0.0, 1.0, 0.0, 0.002,
          0.0, 0.0, 1.0, 0.001, 0.0,0.0,0.0,1.0]
Camera.width: 512
Camera.height: 512
Camera.RGB: 1
"""


def test_orb_slam3_is_opencvs_fisheye_and_holds_both_cameras(tmp_path):
    (tmp_path / "TUM-VI.yaml").write_text(TUM_VI)
    left, right = load_all(tmp_path / "TUM-VI.yaml").values()
    k = [[190.97847715128717, 0, 254.93170605935475], [0, 190.9733070521226, 256.8974428996504], [0, 0, 1]]
    points, pixels = opencv_fisheye(
        k, [0.0034823894022493434, 0.0007150348452162257, -0.0020532361418706202, 0.00020293673591811182]
    )
    assert left.project(points)[0] == pytest.approx(pixels, abs=1e-9)
    assert right.model.fx == 190.44236969414825
    assert left.extra["Stereo.T_c1_c2"]["data"][3] == 0.101


def test_orb_slam3_older_keys_and_orb_slam2(load_text):
    old = TUM_VI.replace('File.version: "1.0"\n', "").replace("Camera1.", "Camera.")
    old = old[: old.index("Camera2.fx")] + old[old.index("Camera.width") :]
    new = TUM_VI[: TUM_VI.index("Camera2.fx")] + TUM_VI[TUM_VI.index("Camera.width") :]
    assert load_text(old).model == load_text(new).model
    ints = (
        "%YAML:1.0\nCamera.fx: 700\nCamera.fy: 701\nCamera.cx: 320\nCamera.cy: 240\nCamera.k1: -0.3\nCamera.k2: 0.1\n"
    )
    assert load_text(ints + "Camera.p1: 0\nCamera.p2: 0\n").model.name == "radial_tangential"
    assert load_text(ints).size == (0, 0)
    with pytest.raises(FormatError, match=r"Camera1\.k4 missing"):
        load_text(new.replace("Camera1.k4", "Camera1.q4"))
    with pytest.raises(FormatError, match="image width must be a number, got None"):
        load_text(new.replace("Camera.width", "Camera.w"))


# -- stella_vslam ---------------------------------------------------------------------------------------------------

STELLA = """# a comment
Camera:
  name: "GoPro"
  setup: monocular
  model: {model}
  fx: 400
  fy: 401.5
  cx: 320.
  cy: 240
{own}  cols: 640
  rows: 480

Preprocessing:
  min_size: 800
"""


def test_stella_vslam_models(load_text):
    fisheye = load_text(STELLA.format(model="fisheye", own="  k1: 0.1\n  k2: 0.02\n  k3: 0.003\n  k4: 0.0004\n"))
    assert fisheye.model == model_class("kannala_brandt")(400.0, 401.5, 320.0, 240.0, 0.1, 0.02, 0.003, 0.0004)
    assert fisheye.extra["Preprocessing"] == {"min_size": 800}
    division = load_text(STELLA.format(model='"radial_division"', own="  distortion: -0.2\n"))
    # radial_division.cc: undistorted = distorted/(1 + distortion r^2).
    x, y = (500.0 - 320) / 400, (300.0 - 240) / 401.5
    bearing = np.array([x, y, 1 - 0.2 * (x * x + y * y)])
    assert division.unproject([500.0, 300.0])[0] == pytest.approx(bearing / np.linalg.norm(bearing), abs=1e-12)
    with pytest.raises(FormatError, match="k4 missing; fisheye has fx"):
        load_text(STELLA.format(model="fisheye", own="  k1: 0.1\n  k2: 0.02\n  k3: 0.003\n"))


def test_openvslam_writes_flat_names(load_text):
    flat = '%YAML:1.0\nCamera.name: "THETA"\nCamera.model: "equirectangular"\nCamera.fps: 30.0\n'
    camera = load_text(flat + "Camera.cols: 1920\nCamera.rows: 960\n")
    assert camera.size == (1920, 960)
    assert camera.project([0, 0, 1.0])[0] == pytest.approx([959.5, 479.5])


# -- Gyroflow: a profile of a DJI Air 2S --------------------------------------------------------------------------

GYROFLOW = {
    "name": "DJI_Air 2S",
    "calib_dimension": {"w": 3840, "h": 2160},
    "input_horizontal_stretch": 1.0,
    "fisheye_params": {
        "RMS_error": 0.748,
        "camera_matrix": [[1979.2455, 0.0, 1971.958], [0.0, 1976.4309, 1091.8437], [0.0, 0.0, 1.0]],
        "distortion_coeffs": [0.30204542798526735, 0.261619680314199, -0.6428789832407675, 0.7795101280096046],
        "radial_distortion_limit": None,
    },
    "distortion_model": None,
}


def test_gyroflow_is_opencvs_fisheye(load_text):
    camera, given = load_text(json.dumps(GYROFLOW)), GYROFLOW["fisheye_params"]
    ahead = POINTS * (0.4, 0.4, 1)
    points, pixels = opencv_fisheye(given["camera_matrix"], given["distortion_coeffs"], ahead)
    projected, valid = camera.project(points)
    assert valid.sum() > 20
    assert projected[valid] == pytest.approx(pixels[valid], abs=1e-9)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("distortion_model", "poly5", "unknown distortion_model 'poly5'"),
        ("digital_lens", "gopro_superview", "digital_lens 'gopro_superview'"),
        ("input_horizontal_stretch", 1.33, "input_horizontal_stretch is 1.33"),
    ],
)
def test_gyroflow_refuses_other_lens_models(load_text, key, value, message):
    with pytest.raises(FormatError, match=message):
        load_text(json.dumps(GYROFLOW | {key: value}))


# -- NumPy ------------------------------------------------------------------------------------------------------

K = np.array([[400.0, 0, 320], [0, 401, 240], [0, 0, 1]])


def npz(tmp_path, **arrays):
    np.savez(tmp_path / "camera.npz", **arrays)
    return load(tmp_path / "camera.npz")


def test_numpy_names_shapes_and_types(tmp_path):
    d = np.array([[0.1, 0.02, 0.003, 0.0004]])
    fisheye = npz(tmp_path, K=K, D=d, fisheye=True)
    assert fisheye.model == model_class("kannala_brandt")(400.0, 401.0, 320.0, 240.0, 0.1, 0.02, 0.003, 0.0004)
    assert fisheye.size == (0, 0)
    sized = npz(tmp_path, mtx=K.astype(int), dist=d.T.astype("f4"), fisheye=1, image_size=[640, 480])
    assert (sized.size, sized.model.fx) == ((640, 480), 400.0)
    assert npz(tmp_path, camera_matrix=np.asfortranarray(K.T).T, dist_coeffs=np.zeros((1, 5))).model.name == "pinhole"
    with pytest.raises(FormatError, match=r"ambiguous.*fisheye"):
        npz(tmp_path, K=K, D=d)


@pytest.mark.parametrize("value", [1e7, 1e11, -1e11, 1e305, 1e-300])
def test_numpy_extreme_numbers_are_refused_or_project_without_warnings(tmp_path, value):
    directions = np.random.default_rng(0).normal(size=(40, 3))
    for count in (0, 4, 5, 8):
        for k, d in ((K, np.full(count, value)), (K * [[value], [1], [1]], np.zeros(count))):
            with contextlib.suppress(FormatError):
                pixels, valid = npz(tmp_path, K=k, D=d, fisheye=int(count == 4)).model.project_numpy(directions)
                assert np.isfinite(pixels[valid]).all()


def test_numpy_refuses_pickles_and_wrong_sizes(tmp_path):
    with pytest.raises(FormatError, match="no distortion coefficients"):
        npz(tmp_path, K=K, D=np.array([{"a": 1}], dtype=object))
    np.save(tmp_path / "single.npy", K)
    with pytest.raises(FormatError, match=r"without a name; save both with np\.savez"):
        load(tmp_path / "single.npy")
    import zipfile

    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    with zipfile.ZipFile(tmp_path / "liar.npz", "w") as archive:
        archive.writestr("K.npy", header.getvalue() + b"\0" * 80)
    with pytest.raises(FormatError, match=r"claims .*1000000000000"):
        load(tmp_path / "liar.npz")
    with zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("K.npy", b"\0" * 20_000_000)
    with pytest.raises(FormatError, match="larger than"):
        load(tmp_path / "bomb.npz")
    whole = (tmp_path / "camera.npz").read_bytes()
    for end in range(0, len(whole), 37):
        (tmp_path / "cut.npz").write_bytes(whole[:end])
        with pytest.raises(FormatError):
            load(tmp_path / "cut.npz")


# -- COLMAP's binary ----------------------------------------------------------------------------------------------


def test_colmap_binary_equals_its_text(tmp_path):
    cameras = [
        (3, 5, 640, 480, (400.0, 401.0, 320.0, 240.0, 0.1, 0.02, 0.003, 0.0004)),
        (7, 17, 1024, 512, (1024.0, 512.0)),
    ]
    head = struct.pack("<Q", len(cameras))
    body = [struct.pack(f"<IiQQ{len(p)}d", key, model, w, h, *p) for key, model, w, h, p in cameras]
    (tmp_path / "cameras.bin").write_bytes(head + b"".join(body))
    found = load_all(tmp_path / "cameras.bin")
    assert list(found) == ["3", "7"]
    assert found["3"].model == model_class("kannala_brandt")(400.0, 401.0, 319.5, 239.5, 0.1, 0.02, 0.003, 0.0004)
    assert found["7"].model.name == "equirectangular"
    (tmp_path / "cameras.bin").write_bytes((head + b"".join(body))[:-3])
    with pytest.raises(FormatError, match="cut off after 1"):
        load_all(tmp_path / "cameras.bin")


# -- ROS ------------------------------------------------------------------------------------------------------

ECHO = """header:
  seq: 7
  frame_id: "left"
height: 480
width: 640
distortion_model: "equidistant"
D: [0.1, 0.02, 0.003, 0.0004]
K: [400.0, 0.0, 320.0, 0.0, 401.0, 240.0, 0.0, 0.0, 1.0]
R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
P: [400.0, 0.0, 320.0, 0.0, 0.0, 401.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 0
---
header:
  seq: 8
"""


def test_ros_messages_printed_by_rostopic_echo(load_text, tmp_path):
    camera = load_text(ECHO)
    assert camera.model == model_class("kannala_brandt")(400.0, 401.0, 320.0, 240.0, 0.1, 0.02, 0.003, 0.0004)
    assert camera.size == (640, 480)
    two = ECHO.replace("D:", "d:").replace("K:", "k:").replace("R:", "r:").replace("P:", "p:")
    assert load_text(two).model == camera.model
    foxglove = {"width": 640, "height": 480, "distortion_model": "equidistant", "D": [0.1, 0.02, 0.003, 0.0004]}
    foxglove |= {"K": [400.0, 0, 320, 0, 401, 240, 0, 0, 1], "frame_id": "left"}
    assert load_text(json.dumps(foxglove)).model == camera.model
    assert save(camera, tmp_path / "c.yaml", format="ros").error_px < 1e-9


# -- our own ----------------------------------------------------------------------------------------------------


def test_native_keeps_every_value_of_a_calibration(tmp_path):
    message = {
        "rms": 0.2,
        "verdict": "good",
        "reasons": ["all of it", {"theta": [1, None, True]}],
        "nested": {"a": {"b": 1}},
    }
    save(Camera(model_class("mei").example(), (640, 480), calibration=message), tmp_path / "c.json")
    assert load(tmp_path / "c.json").calibration == message
