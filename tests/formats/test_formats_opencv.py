"""The traps of OpenCV's storage, and of ROS, which has the same coefficients."""

import re

import numpy as np
import pytest

from omnisight.camera import Camera
from omnisight.formats import FormatError, load, load_all, save
from omnisight.geometry.pose import Pose
from omnisight.models import model_class
from omnisight.rig import Rig

FOUR = """%YAML:1.0
---
image_width: 640
image_height: 480
{extra}camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 400., 0., 320., 0., 401., 240.,
       0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 4
   cols: 1
   dt: d
   data: [ 0.1, 0.02, 0.003,
       0.0004 ]
"""


def params(camera):
    return camera.model.to_dict()


def test_opencv_four_coefficients_are_ambiguous(load_text):
    with pytest.raises(FormatError, match=r"ambiguous.*fisheye_model: 1.*fisheye_model: 0"):
        load_text(FOUR.format(extra=""))
    assert params(load_text(FOUR.format(extra="fisheye_model: 1\n")))["k3"] == 0.003
    assert params(load_text(FOUR.format(extra="fisheye_model: 0\n")))["p1"] == 0.003
    assert load_text(FOUR.format(extra='distortion_model: "equidistant"\n')).model.name == "kannala_brandt"
    assert params(load_text(FOUR.format(extra="xi: 1.2\n")))["p2"] == 0.0004


def test_opencv_key_names_of_all_versions_and_cases(load_text):
    text = FOUR.format(extra="fisheye_model: 1\n")
    old = text.replace("image_width", "image_Width").replace("image_height", "image_Height")
    old = old.replace("camera_matrix", "Camera_Matrix").replace("distortion_coefficients", "Distortion_Coefficients")
    short = text.replace("camera_matrix", "K").replace("distortion_coefficients", "D")
    assert load_text(old).model == load_text(short).model == load_text(text).model
    assert load_text(old).size == (640, 480)


def test_opencv_names_without_a_space_and_newer_heads(load_text):
    text = FOUR.format(extra="fisheye_model:1\n").replace("image_width: ", "image_width:")
    assert load_text(text).size == (640, 480)
    assert load_text(text.replace("%YAML:1.0", "%YAML 1.2")).model == load_text(text).model
    assert load_text(text.replace("%YAML:1.0\n---\n", "")).model == load_text(text).model


def test_opencv_integers_where_reals_are_expected(load_text):
    text = FOUR.format(extra="fisheye_model: 1\n").replace("400., 0., 320.", "400, 0, 320")
    assert params(load_text(text))["fx"] == 400.0


def test_opencv_without_a_size_is_read_and_shown_as_unknown(load_text, tmp_path):
    text = FOUR.format(extra="fisheye_model: 1\n")
    camera = load_text(re.sub(r"image_.*\n", "", text))
    assert camera.size == (0, 0)
    written = save(camera, tmp_path / "again", format="opencv")
    assert written.error_px < 1e-9
    assert "size is not known" in written.notes[0]
    assert load(tmp_path / "again").size == (0, 0)


def test_opencv_without_coefficients_may_be_cut_off(load_text):
    text = FOUR.format(extra="fisheye_model: 0\n")
    with pytest.raises(FormatError, match=r"camera_matrix has no distortion coefficients.*five zeros"):
        load_text(text[: text.index("distortion_coefficients")])


def test_opencv_twelve_coefficients_end_in_zeros_or_are_refused(load_text):
    def with_coefficients(values):
        text = FOUR.format(extra="").replace("rows: 4\n", f"rows: {len(values)}\n")
        return load_text(re.sub(r"0\.1, 0\.02, 0\.003,\s+0\.0004", ", ".join(map(str, values)), text))

    eight = [0.3, 0.05, 4e-4, -3e-4, 0.002, 0.6, 0.12, 0.011]
    assert with_coefficients([*eight, 0, 0, 0, 0]).model == with_coefficients(eight).model
    assert with_coefficients([*eight, 0, 0, 0, 0, 0, 0]).model.name == "rational"
    with pytest.raises(FormatError, match=r"thin-prism.*0\.001"):
        with_coefficients([*eight, 0.001, 0, 0, 0])
    assert with_coefficients([0.1, 0.02, 0, 0, 0.3]).model.name == "radial_tangential"
    assert with_coefficients([0, 0, 0, 0, 0]).model.name == "pinhole"
    with pytest.raises(FormatError, match="7 coefficients"):
        with_coefficients([1] * 7)


def test_opencv_skew_belongs_to_omnidir_and_is_refused_where_opencv_ignores_it(load_text):
    text = FOUR.format(extra="xi: 1.2\n").replace("400., 0., 320.", "400., 0.5, 320.")
    assert params(load_text(text))["skew"] == 0.5
    with pytest.raises(FormatError, match=r"skew of 0\.5 px"):
        load_text(text.replace("xi: 1.2", "fisheye_model: 1"))


def test_opencv_a_stereo_pair_holds_two_cameras(tmp_path):
    one = FOUR.format(extra="fisheye_model: 1\n")
    left = one.replace("camera_matrix", "M1").replace("distortion_coefficients", "D1")
    right = one[one.index("camera_matrix") :].replace("camera_matrix", "M2").replace("distortion_coefficients", "D2")
    (tmp_path / "intrinsics.yml").write_text(left + right.replace("400.", "420."))
    cameras = load_all(tmp_path / "intrinsics.yml")
    assert [c.model.params[0] for c in cameras.values()] == [400.0, 420.0]
    assert list(cameras) == ["camera1", "camera2"]


def test_opencv_unknown_fields_are_kept(load_text):
    camera = load_text(
        FOUR.format(extra='fisheye_model: 1\ncalibration_time: "Mon 3: x"\nflags: 8\nper_view: [.Nan, 1.]\n')
    )
    assert camera.extra == {"calibration_time": "Mon 3: x", "flags": 8, "per_view": [".Nan", 1.0]}


def test_ros_reads_both_cameras_of_a_stereo_pair_by_name(tmp_path):
    models = [model_class(name).example() for name in ("kannala_brandt", "radial_tangential")]
    shift = Pose(np.eye(3), np.array([-0.2, 0, 0]))
    rig = Rig(tuple(Camera(model, (960, 720)) for model in models), (Pose(), shift), ("left", "right"))
    save(rig, tmp_path / "pair.yaml", format="ros")
    with pytest.raises(FormatError, match=r"holds 2 cameras: left, right; specify one"):
        load(tmp_path / "pair.yaml")
    assert load(tmp_path / "pair.yaml", name="right").model == models[1]


def test_ros_messages_of_two_cameras_are_distinguished_by_their_frame(tmp_path):
    echo = """header:
  frame_id: "{name}"
height: 480
width: 640
distortion_model: "equidistant"
D: [0.1, 0.02, 0.003, 0.0004]
K: [{focal}, 0.0, 320.0, 0.0, 401.0, 240.0, 0.0, 0.0, 1.0]
"""
    messages = [echo.format(name=name, focal=focal) for name, focal in [("left", 400.0), ("right", 410.0)] * 2]
    (tmp_path / "echo.yaml").write_text("---\n".join([*messages, "header:\n  seq: 8\n"]))
    found = load_all(tmp_path / "echo.yaml")
    assert {name: camera.model.to_dict()["fx"] for name, camera in found.items()} == {"left": 400.0, "right": 410.0}
