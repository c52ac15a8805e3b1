"""The traps of the other formats, on texts as their tools write them."""

import dataclasses
import re

import pytest

from omnisight.camera import Camera
from omnisight.formats import FormatError, get_format, load, load_all, save
from omnisight.models import model_class


def params(camera):
    return camera.model.to_dict()


CHAIN = """cam0:
  cam_overlaps:
  - 1
  camera_model: omni
  distortion_coeffs: [-0.1, 0.02, 0.0003, -0.0004]
  distortion_model: radtan
  intrinsics: [1.7, 710.0, 711, 320.5, 240.5]
  resolution: [640, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, 0.1]
  - [0.0, 1.0, 0.0, 0.0]
  - - 0.0
    - 0.0
    - 1.0
    - 0.0
  camera_model: ds
  distortion_coeffs: []
  distortion_model: none
  intrinsics: [-0.2, 0.6, 300.0, 301.0, 320.5, 240.5]   # xi alpha first
  resolution: [640, 480]
"""


def test_kalibr_model_parameters_come_first(tmp_path):
    (tmp_path / "chain.yaml").write_text(CHAIN)
    omni, ds = load_all(tmp_path / "chain.yaml").values()
    assert omni.model == model_class("mei")(710.0, 711.0, 320.5, 240.5, 1.7, -0.1, 0.02, 0.0003, -0.0004)
    assert (ds.model.xi, ds.model.alpha, ds.model.fx) == (-0.2, 0.6, 300.0)
    assert omni.extra == {"cam_overlaps": [1], "rostopic": "/cam0/image_raw"}
    assert ds.extra["T_cn_cnm1"][2] == [0.0, 0.0, 1.0, 0.0]


def test_kalibr_writes_reals_as_reals_and_the_size_as_integers(tmp_path):
    camera = Camera(model_class("kannala_brandt")(640.0, 640.0, 320.0, 240.0, 1e-5, 0.0, 0.0, 0.0), (640, 480))
    save(camera, tmp_path / "chain.yaml", format="kalibr")
    text = (tmp_path / "chain.yaml").read_text()
    assert "[640.0, 640.0, 320.0, 240.0]" in text
    assert "resolution: [640, 480]" in text
    assert "[1.0e-05, 0.0" in text  # YAML 1.1 takes 1e-05 for a text


def test_kalibr_negative_xi_is_noted(tmp_path):
    model = dataclasses.replace(model_class("unified").example(), xi=-0.1, skew=0.0)
    notes = save(Camera(model, (640, 480)), tmp_path / "chain.yaml", format="kalibr").notes
    assert "xi < 0" in notes[0]


def test_kalibr_keeps_fields_of_a_single_camera(tmp_path):
    (tmp_path / "chain.yaml").write_text(CHAIN)
    notes = save(load(tmp_path / "chain.yaml", name="cam1"), tmp_path / "one.yaml", format="kalibr").notes
    assert notes[0] == "not written: T_cn_cnm1"
    save(load(tmp_path / "chain.yaml", name="cam0"), tmp_path / "one.yaml", format="kalibr")
    assert load(tmp_path / "one.yaml").extra == {"rostopic": "/cam0/image_raw"}


def test_kalibr_truncated_lens_does_not_lose_distortion(load_text):
    with pytest.raises(FormatError, match=r"distortion_model.*missing"):
        load_text(
            "cam0:\n  camera_model: pinhole\n  intrinsics: [400.0, 400.0, 320.0, 240.0]\n  resolution: [640, 480]\n"
        )


def test_kalibr_reads_the_sensor_yaml_of_euroc(load_text):
    camera = load_text(
        "sensor_type: camera\nrate_hz: 20\nresolution: [752, 480]\ncamera_model: pinhole\n"
        "intrinsics: [458.654, 457.296, 367.215, 248.375] #fu, fv, cu, cv\ndistortion_model: radial-tangential\n"
        "distortion_coefficients: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]\n"
    )
    assert camera.model.name == "radial_tangential"
    assert camera.extra == {"sensor_type": "camera", "rate_hz": 20}


def test_ros_names_and_six_digits(load_text):
    text = get_format("ros").serialize(Camera(model_class("kannala_brandt").example(), (960, 960)))[0]
    assert "distortion_model: equidistant" in text or 'distortion_model: "equidistant"' in text
    old = text.replace("distortion_model", "camera_model").replace("equidistant", "fisheye")
    assert load_text(old).model == load_text(text).model
    block = text.replace("camera_matrix: {", "camera_matrix:\n  {")
    assert load_text(block).model == load_text(text).model


def test_ros_four_coefficients_need_a_model(load_text):
    text = get_format("ros").serialize(Camera(model_class("kannala_brandt").example(), (960, 960)))[0]
    with pytest.raises(FormatError, match="ambiguous"):
        load_text(re.sub("distortion_model.*\n", "", text))


def test_colmap_pixels_have_a_half_pixel_offset(load_text):
    camera = load_text("1 OPENCV_FISHEYE 640 480 400 401 320 240 0.1 0.02 0.003 0.0004\n")
    assert (camera.model.cx, camera.model.cy) == (319.5, 239.5)


@pytest.mark.parametrize(
    ("line", "model"),
    [
        ("SIMPLE_PINHOLE 640 480 400.0 320.0 240.0", "pinhole"),
        ("SIMPLE_RADIAL 640 480 400.0 320.0 240.0 0.1", "radial_tangential"),
        ("RADIAL 640 480 400.0 320.0 240.0 0.1 0.02", "radial_tangential"),
        ("OPENCV 640 480 400.0 401.0 320.0 240.0 0.1 0.02 0.001 0.002", "radial_tangential"),
        ("SIMPLE_RADIAL_FISHEYE 640 480 400.0 320.0 240.0 0.1", "kannala_brandt"),
        ("RADIAL_FISHEYE 640 480 400.0 320.0 240.0 0.1 0.02", "kannala_brandt"),
        ("SIMPLE_DIVISION 640 480 400.0 320.0 240.0 -0.1", "division"),
        ("SIMPLE_FISHEYE 640 480 400.0 320.0 240.0", "equidistant"),
        ("EQUIRECTANGULAR 1024 512 1024.0 512.0", "equirectangular"),
    ],
)
def test_colmap_writes_the_most_specific_name(line, model, load_text):
    camera = load_text(f"# a comment\n1 {line}")
    assert camera.model.name == model
    assert get_format("colmap").serialize(camera)[0].splitlines()[-1] == f"1 {line}"


def test_colmap_errors_name_the_line(load_text):
    with pytest.raises(FormatError, match=r"line 2: unknown camera model 'SPHERE'.*EQUIRECTANGULAR"):
        load_text("# x\n1 SPHERE 640 480 1 1 1\n")
    with pytest.raises(FormatError, match=r"line 1: PINHOLE has 4 parameters \(fx, fy, cx, cy\), got 3"):
        load_text("1 PINHOLE 640 480 1 1 1\n")


def test_camodocal_fisheye_coefficients_start_at_k2(load_text):
    text = (
        "%YAML:1.0\n---\nmodel_type: KANNALA_BRANDT\ncamera_name: camera\nimage_width: 640\nimage_height: 480\n"
        "projection_parameters:\n   k2: 0.1\n   k3: 0.02\n   k4: 0.003\n   k5: 0.0004\n"
        "   mu: 400\n   mv: 401\n   u0: 320\n   v0: 240\n"
    )
    assert load_text(text).model == model_class("kannala_brandt")(400.0, 401.0, 320.0, 240.0, 0.1, 0.02, 0.003, 0.0004)
    with pytest.raises(FormatError, match=r"projection_parameters must hold k2, k3"):
        load_text(text.replace("k5", "k6"))


def test_basalt_unified_model_uses_alpha(load_text):
    camera = load_text(
        '{"value0": {"T_imu_cam": [{"px": 0.1}], "intrinsics": [{"camera_type": "ucm", "intrinsics":'
        ' {"fx": 200.0, "fy": 201.0, "cx": 320, "cy": 240, "alpha": 0.5}}], "resolution": [[640, 480]]}}'
    )
    assert (camera.model.xi, camera.model.fx) == (1.0, 400.0)
    assert camera.extra == {"T_imu_cam": {"px": 0.1}}


def test_mrcal_text_is_python_and_never_evaluated(load_text):
    text = (
        "# made by mrcal\n{\n    'lensmodel':  'LENSMODEL_OPENCV4',\n\n    # intrinsics are fx,fy,cx,cy,...\n"
        "    'intrinsics': [ 400., 401, 320.5, 240.5, 0.1, 0.02, 0.003, 0.0004,],\n    'imagersize': [ 640, 480,],\n"
        "    'icam_intrinsics': None,\n    'optimization_inputs': b'x{]#,,:',\n}\n"
    )
    assert params(load_text(text))["p2"] == 0.0004
    assert load_text(text).extra == {"icam_intrinsics": None, "optimization_inputs": "x{]#,,:"}
    with pytest.raises(FormatError):
        load_text(text.replace("400.", "__import__('os').abort()"))


def test_opensfm_lengths_are_relative_to_the_longer_side(load_text):
    camera = load_text(
        '{"v2 cam 640 480": {"projection_type": "fisheye_opencv", "width": 640, "height": 480, "focal_x": 0.5,'
        ' "focal_y": 0.5, "c_x": 0.01, "c_y": 0.0, "k1": 0.1, "k2": 0, "k3": 0, "k4": 0, "k1_prior": 0.1}}'
    )
    assert params(camera) == {"fx": 320, "fy": 320, "cx": 325.9, "cy": 239.5, "k1": 0.1, "k2": 0, "k3": 0, "k4": 0}
    assert camera.extra == {"k1_prior": 0.1}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"calibration": [1, 2]}, '"calibration" must be an object'),
        ({"provenance": "me"}, '"provenance" must be an object'),
        ({"theta_max_deg": -5}, "theta_max_deg must lie between 0 and 180"),
        ({"theta_max_deg": 80, "theta_min_deg": 170}, "theta_min_deg must lie between 0 and theta_max_deg"),
        ({"theta_min_deg": "x"}, "theta_min_deg must be a number"),
        ({"covariance": [[1.0]]}, "covariance must have 4 rows of 4 numbers"),
        ({"covariance": [[-1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}, "negative variance"),
        ({"version": -3}, "invalid version -3"),
    ],
)
def test_native_refuses_invalid_fields(tmp_path, change, message):
    import json

    from omnisight.camera import Camera
    from omnisight.formats import FormatError, load
    from omnisight.formats.native import to_json
    from omnisight.models import model_class

    stored = to_json(Camera(model_class("equidistant").example(), (640, 480))) | change
    (tmp_path / "camera.json").write_text(json.dumps(stored))
    with pytest.raises(FormatError, match=r"camera\.json") as error:
        load(tmp_path / "camera.json")
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("model", "change", "message"),
    [
        ("mei", {"xi": -5.0}, r"xi must lie in \[-0\.999, inf\], got -5"),
        ("eucm", {"beta": 0.0}, r"beta must lie in \[0\.001, inf\], got 0"),
        ("fov", {"omega": 1e-300}, r"omega must lie in \[0\.01, 3\.1\], got 0"),
        ("ocam", {"a0": 0.0}, r"a0 \(focal length, px\) must be 1e-06 or longer, got 0"),
        (
            "rational",
            {"k3": 1e-150, "k5": -1e12, "k6": -1e-150},
            r"no rational camera has these numbers \(.*k6 = -1e-150",
        ),
    ],
)
def test_native_refuses_invalid_parameters(tmp_path, model, change, message):
    import json

    from omnisight.camera import Camera
    from omnisight.formats import FormatError, load
    from omnisight.formats.native import to_json
    from omnisight.models import model_class

    stored = to_json(Camera(model_class(model).example(), (640, 480)))
    stored["params"] |= change
    (tmp_path / "camera.json").write_text(json.dumps(stored))
    with pytest.raises(FormatError, match=message):
        load(tmp_path / "camera.json")


def test_native_refuses_invalid_ray_camera_parameters(tmp_path):
    import json

    from omnisight.formats import FormatError, load
    from omnisight.formats.native import to_json
    from omnisight.optics import Catadioptric
    from omnisight.ray_camera import RayCamera

    stored = to_json(RayCamera(Catadioptric.example(), (640, 480)))
    for change, message in (
        ({"mirror_eccentricity": -0.5}, "mirror_eccentricity must lie in"),
        ({"fx": 1e300}, "fx must be a number"),
    ):
        changed = stored | {"params": stored["params"] | change}
        (tmp_path / "camera.json").write_text(json.dumps(changed))
        with pytest.raises(FormatError, match=message):
            load(tmp_path / "camera.json")


@pytest.mark.parametrize(
    ("lens", "change", "message"),
    [
        ("ocam", {f"a{i}": 1e-12 for i in range(5, 600)}, r"f\(r\) has 599 coefficients, at most 20 are read"),
        ("kannala_brandt", {"fx": 0.0}, r"fx \(focal length, px\) must be 1e-06 or longer, got 0"),
        (
            "rational",
            {"k3": 1e-150, "k5": -1e12, "k6": -1e-150},
            r"no rational camera has these numbers \(.*k6 = -1e-150",
        ),
    ],
)
def test_native_refuses_invalid_lens_parameters(tmp_path, lens, change, message):
    import json

    from omnisight.formats import FormatError, load
    from omnisight.formats.native import to_json
    from omnisight.models import model_class
    from omnisight.optics.models.axial import Axial
    from omnisight.ray_camera import RayCamera

    stored = to_json(RayCamera(Axial(model_class(lens).example(), (0.006,)), (640, 480)))
    stored["params"] |= change
    (tmp_path / "camera.json").write_text(json.dumps(stored))
    with pytest.raises(FormatError, match=message):
        load(tmp_path / "camera.json")
