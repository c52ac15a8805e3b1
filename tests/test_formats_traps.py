"""The trap of each format, by name, on texts as other tools write them."""

import dataclasses
import re

import numpy as np
import pytest

from omnisight.camera import Camera
from omnisight.formats import FormatError, format_named, load, load_all, save
from omnisight.formats._yaml import read
from omnisight.models import model_class

OCAM = """#polynomial coefficients for the DIRECT mapping function (ocam_model.ss in MATLAB).

5 -4.714441e+02 0.000000e+00 7.356108e-04 -3.773045e-07 5.800006e-10

#whatever a port says here
3 772.4 504.7 7.0

#camera center in pixel coordinates
300.25 400.75

#affine
1.000305 -0.000277 -0.000925

#image size
600 800
"""
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


@pytest.fixture
def get(tmp_path):
    def camera(text):
        (tmp_path / "file").write_text(text)
        return load(tmp_path / "file")

    return camera


def params(camera):
    return camera.model.to_dict()


# -- OCamCalib -------------------------------------------------------------------------------------------------


def test_ocamcalib_centre_is_row_column_and_size_height_width(get):
    camera = get(OCAM)
    assert (camera.model.cx, camera.model.cy) == (400.75, 300.25)
    assert camera.size == (800, 600)


def test_ocamcalib_z_is_back_so_the_polynomial_changes_sign(get):
    camera = get(OCAM)
    assert camera.model.a == (471.4441, -7.356108e-04, 3.773045e-07, -5.800006e-10)
    with pytest.raises(FormatError, match=r"a0 must be negative.*471"):
        get(OCAM.replace("-4.714441e+02", "4.714441e+02"))


def test_ocamcalib_x_is_down_and_y_right(get):
    """A ray of OCamCalib's own cam2world, computed by its formula here."""
    camera = get(OCAM)
    row, column = 350.0, 500.0
    stretch = np.array([[1.000305, -0.000277], [-0.000925, 1.0]])
    x, y = np.linalg.solve(stretch, [row - 300.25, column - 400.75])
    z = np.polynomial.polynomial.polyval(np.hypot(x, y), [-4.714441e02, 0, 7.356108e-04, -3.773045e-07, 5.800006e-10])
    bearing, _ = camera.unproject([column, row])
    assert bearing == pytest.approx(np.array([y, x, -z]) / np.linalg.norm([x, y, z]), abs=1e-12)


def test_ocamcalib_a1_must_be_zero(get):
    assert len(get(OCAM.replace(" 0.000000e+00", " 1e-12", 1)).model.a) == 4
    with pytest.raises(FormatError, match=r"a1 must be 0.*0\.01"):
        get(OCAM.replace(" 0.000000e+00", " -0.01", 1))


def test_ocamcalib_a_wrong_inverse_polynomial_changes_nothing_and_is_kept(get):
    wrong = get(OCAM.replace("3 772.4 504.7 7.0", "2 1 1"))
    assert wrong.model == get(OCAM).model
    assert wrong.extra == {"inverse_polynomial": [1.0, 1.0]}


def test_ocamcalib_three_digit_exponents_of_windows(get):
    assert get(OCAM.replace("e-04", "e-004").replace("e+02", "e+002")).model == get(OCAM).model


def test_ocamcalib_counts_that_do_not_match_are_refused(get):
    with pytest.raises(FormatError, match="direct polynomial: says 5 coefficients and has 4"):
        get(OCAM.replace(" 5.800006e-10", ""))
    with pytest.raises(FormatError, match="ends before the size"):
        get(OCAM.replace("600 800", ""))


def test_ocamcalib_writes_an_inverse_polynomial_that_its_own_programs_can_use(tmp_path):
    camera = Camera(model_class("ocam").example(), (1024, 768))
    save(camera, tmp_path / "calib_results.txt", format="ocamcalib")
    rows = [line.split() for line in (tmp_path / "calib_results.txt").read_text().splitlines() if line[:1] not in "#"]
    assert len(rows) == 5
    inverse = [float(word) for word in rows[1][1:]]
    seen = world2cam(camera, inverse)
    bearings, pixels = camera.samples()
    assert np.linalg.norm(seen(bearings) - pixels, axis=1).max() < 0.011


def world2cam(camera, inverse):
    """OCamCalib's world2cam with its inverse polynomial, in its frame."""
    m = camera.model

    def project(bearings):
        x, y, z = bearings[:, 1], bearings[:, 0], -bearings[:, 2]
        norm = np.maximum(np.hypot(x, y), 1e-300)
        rho = np.polynomial.polynomial.polyval(np.arctan2(z, norm), inverse)
        x, y = x / norm * rho, y / norm * rho
        return np.stack([x * m.e + y + m.cx, x * m.c + y * m.d + m.cy], -1)

    return project


# -- OpenCV ----------------------------------------------------------------------------------------------------


def test_opencv_four_coefficients_are_ambiguous(get):
    with pytest.raises(FormatError, match=r"ambiguous.*fisheye_model: 1.*fisheye_model: 0"):
        get(FOUR.format(extra=""))
    assert params(get(FOUR.format(extra="fisheye_model: 1\n")))["k3"] == 0.003
    assert params(get(FOUR.format(extra="fisheye_model: 0\n")))["p1"] == 0.003
    assert get(FOUR.format(extra='distortion_model: "equidistant"\n')).model.name == "kannala_brandt"
    assert params(get(FOUR.format(extra="xi: 1.2\n")))["p2"] == 0.0004


def test_opencv_names_of_any_case_and_age(get):
    text = FOUR.format(extra="fisheye_model: 1\n")
    old = text.replace("image_width", "image_Width").replace("image_height", "image_Height")
    old = old.replace("camera_matrix", "Camera_Matrix").replace("distortion_coefficients", "Distortion_Coefficients")
    short = text.replace("camera_matrix", "K").replace("distortion_coefficients", "D")
    assert get(old).model == get(short).model == get(text).model
    assert get(old).size == (640, 480)


def test_opencv_names_without_a_space_and_newer_heads(get):
    text = FOUR.format(extra="fisheye_model:1\n").replace("image_width: ", "image_width:")
    assert get(text).size == (640, 480)
    assert get(text.replace("%YAML:1.0", "%YAML 1.2")).model == get(text).model
    assert get(text.replace("%YAML:1.0\n---\n", "")).model == get(text).model


def test_opencv_integers_where_reals_are_expected(get):
    text = FOUR.format(extra="fisheye_model: 1\n").replace("400., 0., 320.", "400, 0, 320")
    assert params(get(text))["fx"] == 400.0


def test_opencv_without_a_size_is_read_and_shown_as_unknown(get, tmp_path):
    text = FOUR.format(extra="fisheye_model: 1\n")
    camera = get(re.sub(r"image_.*\n", "", text))
    assert camera.size == (0, 0)
    written = save(camera, tmp_path / "again", format="opencv")
    assert written.error_px < 1e-9
    assert "size is not known" in written.notes[0]
    assert load(tmp_path / "again").size == (0, 0)


def test_opencv_without_coefficients_may_be_cut_off(get):
    text = FOUR.format(extra="fisheye_model: 0\n")
    with pytest.raises(FormatError, match="camera_matrix has no distortion coefficients.*five zeros"):
        get(text[: text.index("distortion_coefficients")])


def test_opencv_twelve_coefficients_end_in_zeros_or_are_refused(get):
    def with_coefficients(values):
        text = FOUR.format(extra="").replace("rows: 4\n", f"rows: {len(values)}\n")
        return get(re.sub(r"0\.1, 0\.02, 0\.003,\s+0\.0004", ", ".join(map(str, values)), text))

    eight = [0.3, 0.05, 4e-4, -3e-4, 0.002, 0.6, 0.12, 0.011]
    assert with_coefficients([*eight, 0, 0, 0, 0]).model == with_coefficients(eight).model
    assert with_coefficients([*eight, 0, 0, 0, 0, 0, 0]).model.name == "rational"
    with pytest.raises(FormatError, match=r"thin-prism.*0\.001"):
        with_coefficients([*eight, 0.001, 0, 0, 0])
    assert with_coefficients([0.1, 0.02, 0, 0, 0.3]).model.name == "radial_tangential"
    assert with_coefficients([0, 0, 0, 0, 0]).model.name == "pinhole"
    with pytest.raises(FormatError, match="7 coefficients"):
        with_coefficients([1] * 7)


def test_opencv_skew_belongs_to_omnidir_and_is_refused_where_opencv_ignores_it(get):
    text = FOUR.format(extra="xi: 1.2\n").replace("400., 0., 320.", "400., 0.5, 320.")
    assert params(get(text))["skew"] == 0.5
    with pytest.raises(FormatError, match=r"skew of 0\.5 px"):
        get(text.replace("xi: 1.2", "fisheye_model: 1"))


def test_opencv_a_stereo_pair_holds_two_cameras(tmp_path):
    one = FOUR.format(extra="fisheye_model: 1\n")
    left = one.replace("camera_matrix", "M1").replace("distortion_coefficients", "D1")
    right = one[one.index("camera_matrix") :].replace("camera_matrix", "M2").replace("distortion_coefficients", "D2")
    (tmp_path / "intrinsics.yml").write_text(left + right.replace("400.", "420."))
    cameras = load_all(tmp_path / "intrinsics.yml")
    assert [c.model.params[0] for c in cameras.values()] == [400.0, 420.0]
    assert list(cameras) == ["camera1", "camera2"]


def test_opencv_what_it_does_not_use_is_kept(get):
    camera = get(FOUR.format(extra='fisheye_model: 1\ncalibration_time: "Mon 3: x"\nflags: 8\nper_view: [.Nan, 1.]\n'))
    assert camera.extra == {"calibration_time": "Mon 3: x", "flags": 8, "per_view": [".Nan", 1.0]}


# -- Kalibr ----------------------------------------------------------------------------------------------------

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


def test_kalibr_the_models_own_parameters_come_first(tmp_path):
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


def test_kalibr_says_that_it_would_refuse_a_negative_xi_itself(tmp_path):
    model = dataclasses.replace(model_class("unified").example(), xi=-0.1, skew=0.0)
    notes = save(Camera(model, (640, 480)), tmp_path / "chain.yaml", format="kalibr").notes
    assert "xi < 0" in notes[0]


def test_kalibr_keeps_what_stays_true_of_a_single_camera(tmp_path):
    (tmp_path / "chain.yaml").write_text(CHAIN)
    notes = save(load(tmp_path / "chain.yaml", name="cam1"), tmp_path / "one.yaml", format="kalibr").notes
    assert notes == ("not held: T_cn_cnm1",)
    save(load(tmp_path / "chain.yaml", name="cam0"), tmp_path / "one.yaml", format="kalibr")
    assert load(tmp_path / "one.yaml").extra == {"rostopic": "/cam0/image_raw"}


def test_kalibr_a_lens_cut_off_does_not_lose_its_distortion(get):
    with pytest.raises(FormatError, match="distortion_model.*missing"):
        get("cam0:\n  camera_model: pinhole\n  intrinsics: [400.0, 400.0, 320.0, 240.0]\n  resolution: [640, 480]\n")


def test_kalibr_reads_the_sensor_yaml_of_euroc(get):
    camera = get(
        "sensor_type: camera\nrate_hz: 20\nresolution: [752, 480]\ncamera_model: pinhole\n"
        "intrinsics: [458.654, 457.296, 367.215, 248.375] #fu, fv, cu, cv\ndistortion_model: radial-tangential\n"
        "distortion_coefficients: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]\n"
    )
    assert camera.model.name == "radial_tangential"
    assert camera.extra == {"sensor_type": "camera", "rate_hz": 20}


# -- the others ------------------------------------------------------------------------------------------------


def test_ros_names_and_six_digits(get):
    text = format_named("ros").render(Camera(model_class("kannala_brandt").example(), (960, 960)))[0]
    assert "distortion_model: equidistant" in text or 'distortion_model: "equidistant"' in text
    old = text.replace("distortion_model", "camera_model").replace("equidistant", "fisheye")
    assert get(old).model == get(text).model
    block = text.replace("camera_matrix: {", "camera_matrix:\n  {")
    assert get(block).model == get(text).model


def test_ros_four_coefficients_need_a_model(get):
    text = format_named("ros").render(Camera(model_class("kannala_brandt").example(), (960, 960)))[0]
    with pytest.raises(FormatError, match="ambiguous"):
        get(re.sub("distortion_model.*\n", "", text))


def test_colmap_pixels_are_half_a_pixel_farther(get):
    camera = get("1 OPENCV_FISHEYE 640 480 400 401 320 240 0.1 0.02 0.003 0.0004\n")
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
def test_colmap_writes_the_most_specific_name(line, model, get):
    camera = get(f"# a comment\n1 {line}")
    assert camera.model.name == model
    assert format_named("colmap").render(camera)[0].splitlines()[-1] == f"1 {line}"


def test_colmap_says_what_is_wrong_in_which_line(get):
    with pytest.raises(FormatError, match="line 2: no camera model 'SPHERE'.*EQUIRECTANGULAR"):
        get("# x\n1 SPHERE 640 480 1 1 1\n")
    with pytest.raises(FormatError, match=r"line 1: PINHOLE has 4 parameters \(fx, fy, cx, cy\), got 3"):
        get("1 PINHOLE 640 480 1 1 1\n")


def test_camodocal_counts_the_fisheyes_coefficients_from_two(get):
    text = (
        "%YAML:1.0\n---\nmodel_type: KANNALA_BRANDT\ncamera_name: camera\nimage_width: 640\nimage_height: 480\n"
        "projection_parameters:\n   k2: 0.1\n   k3: 0.02\n   k4: 0.003\n   k5: 0.0004\n"
        "   mu: 400\n   mv: 401\n   u0: 320\n   v0: 240\n"
    )
    assert get(text).model == model_class("kannala_brandt")(400.0, 401.0, 320.0, 240.0, 0.1, 0.02, 0.003, 0.0004)
    with pytest.raises(FormatError, match="projection_parameters must hold k2, k3"):
        get(text.replace("k5", "k6"))
    with pytest.raises(FormatError, match="calib_results.txt"):
        get(text.replace("KANNALA_BRANDT", "scaramuzza"))


def test_basalt_the_unified_model_in_alpha(get):
    camera = get(
        '{"value0": {"T_imu_cam": [{"px": 0.1}], "intrinsics": [{"camera_type": "ucm", "intrinsics":'
        ' {"fx": 200.0, "fy": 201.0, "cx": 320, "cy": 240, "alpha": 0.5}}], "resolution": [[640, 480]]}}'
    )
    assert (camera.model.xi, camera.model.fx) == (1.0, 400.0)
    assert camera.extra == {"T_imu_cam": {"px": 0.1}}


def test_mrcal_text_is_python_and_never_evaluated(get):
    text = (
        "# made by mrcal\n{\n    'lensmodel':  'LENSMODEL_OPENCV4',\n\n    # intrinsics are fx,fy,cx,cy,distortion0,...\n"
        "    'intrinsics': [ 400., 401, 320.5, 240.5, 0.1, 0.02, 0.003, 0.0004,],\n    'imagersize': [ 640, 480,],\n"
        "    'icam_intrinsics': None,\n    'optimization_inputs': b'x{]#,,:',\n}\n"
    )
    assert params(get(text))["p2"] == 0.0004
    assert get(text).extra == {"icam_intrinsics": None, "optimization_inputs": "x{]#,,:"}
    with pytest.raises(FormatError):
        get(text.replace("400.", "__import__('os').abort()"))


def test_opensfm_lengths_are_shares_of_the_longer_side(get):
    camera = get(
        '{"v2 cam 640 480": {"projection_type": "fisheye_opencv", "width": 640, "height": 480, "focal_x": 0.5,'
        ' "focal_y": 0.5, "c_x": 0.01, "c_y": 0.0, "k1": 0.1, "k2": 0, "k3": 0, "k4": 0, "k1_prior": 0.1}}'
    )
    assert params(camera) == {"fx": 320, "fy": 320, "cx": 325.9, "cy": 239.5, "k1": 0.1, "k2": 0, "k3": 0, "k4": 0}
    assert camera.extra == {"k1_prior": 0.1}


# -- the reader ------------------------------------------------------------------------------------------------


def test_the_reader_of_yaml():
    text = """%YAML:1.0
---
# a comment
a: 1   # another
b:1.5
"c d": 'it''s # no comment'
e: {x: 1, "y": [true, null, .5, -1e-3,
      2.], z: {}}
f:
    g: "a\\nb"
\th: ~
list:
- 1
- - 2
  - [3]
- k: v
  l: /cam0/x:y
-
  m: 1
empty:
last: 2026-01-02 text"""
    assert read(text.replace("\th: ~", "    h: ~")) == {
        "a": 1,
        "b": 1.5,
        "c d": "it's # no comment",
        "e": {"x": 1, "y": [True, None, 0.5, -1e-3, 2.0], "z": {}},
        "f": {"g": "a\nb", "h": None},
        "list": [1, [2, [3]], {"k": "v", "l": "/cam0/x:y"}, {"m": 1}],
        "empty": None,
        "last": "2026-01-02 text",
    }


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: 1\na: 2", "line 2: a second"),
        ("a: [1, 2", "expected a comma or ]"),
        ("a: {b 1}", "expected a colon after 'b'"),
        ("a: 1\n  b: 2", "wrong indentation|line 2"),
        ("a: [1] 2", "unexpected"),
        ("a: &x 1", "anchors"),
        ("a: |\n  text", "several lines"),
        ("a: 1\njust words", "line 2: expected a name"),
        ("a:\n" + "".join(" " * i + f"a{i}:\n" for i in range(1, 40)), "levels"),
    ],
)
def test_the_reader_says_where(text, said):
    with pytest.raises(ValueError, match=said):
        read(text)
