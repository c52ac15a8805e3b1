"""Formats of reconstruction and panorama programs, against the formulas that their documents state."""

import json

import numpy as np
import pytest

from omnisight.camera import Camera
from omnisight.formats import FormatError, load_all, save
from omnisight.models import model_class

POINTS = np.random.default_rng(3).uniform((-0.6, -0.6, 0.8), (0.6, 0.6, 1.2), (40, 3))


def params(camera):
    return camera.model.to_dict()


# -- nerfstudio: the example of its page on data conventions -------------------------------------------------------

POSE = [[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
TRANSFORMS = {
    "camera_model": "OPENCV_FISHEYE", "fl_x": 1072.0, "fl_y": 1068.0, "cx": 1504.0, "cy": 1000.0, "w": 3008, "h": 2000,
    "k1": 0.0312, "k2": 0.0051, "k3": 0.0006, "k4": 0.0001, "p1": 0, "p2": 0.0,
    "frames": [{"file_path": "images/frame_00001.jpeg", "transform_matrix": POSE}],
}  # fmt: skip


def test_nerfstudio_pixels_have_a_half_pixel_offset_and_frames_are_kept(load_text, tmp_path):
    camera = load_text(json.dumps(TRANSFORMS))
    own = (0.0312, 0.0051, 0.0006, 0.0001)
    assert camera.model == model_class("kannala_brandt")(1072.0, 1068.0, 1503.5, 999.5, *own)
    (note,) = save(camera, tmp_path / "t.json", format="nerfstudio").notes
    assert note.startswith("reader:")
    assert json.loads((tmp_path / "t.json").read_text())["frames"] == TRANSFORMS["frames"]


def test_nerfstudio_files_of_instant_ngp(load_text):
    ngp = {"camera_angle_x": np.pi / 2, "w": 640.0, "h": 480.0, "frames": [], "k1": 0.1, "is_fisheye": False}
    plane = {"fx": 320.0, "fy": 320.0, "cx": 319.5, "cy": 239.5, "k1": 0.1, "k2": 0, "p1": 0, "p2": 0, "k3": 0}
    assert params(load_text(json.dumps(ngp))) == pytest.approx(plane, abs=1e-12)
    assert load_text(json.dumps(ngp | {"is_fisheye": True})).model.name == "kannala_brandt"


def test_nerfstudio_frames_of_two_cameras(tmp_path):
    own = {key: TRANSFORMS[key] for key in ("fl_x", "fl_y", "cx", "cy", "w", "h", "k1", "k2", "k3", "k4")}
    frames = [{"file_path": f"{i}.png", **own, "fl_x": 1000.0 + 10 * (i > 1)} for i in range(4)]
    (tmp_path / "t.json").write_text(json.dumps({"camera_model": "OPENCV_FISHEYE", "frames": frames}))
    assert {name: camera.model.fx for name, camera in load_all(tmp_path / "t.json").items()} == {
        "0.png": 1000.0,
        "2.png": 1010.0,
    }


def test_nerfstudio_refuses_unsupported_cameras(load_text):
    with pytest.raises(FormatError, match="unknown camera_model 'FISHEYE624'"):
        load_text(json.dumps(TRANSFORMS | {"camera_model": "FISHEYE624"}))
    with pytest.raises(FormatError, match="image width must be a number, got None"):
        load_text(json.dumps({key: value for key, value in TRANSFORMS.items() if key != "w"}))


# -- AliceVision --------------------------------------------------------------------------------------------------

INTRINSIC = {
    "intrinsicId": "17", "width": "4000", "height": "3000", "sensorWidth": "8", "sensorHeight": "6",
    "type": "pinhole", "distortionType": "fisheye", "focalLength": "4", "pixelRatio": "1.01",
    "principalPoint": ["10.5", "-20"], "distortionParams": ["0.1", "0.02", "0.003", "0.0004"], "locked": "0",
}  # fmt: skip


def sfm(version, **changes):
    given = {key: value for key, value in (INTRINSIC | changes).items() if value is not None}
    return json.dumps({"version": version.split("."), "views": [], "intrinsics": [given]})


def test_alicevision_focal_length_in_mm_and_numbers_as_texts(load_text):
    camera = load_text(sfm("1.2.13"))
    fisheye = model_class("kannala_brandt")(2000.0, 2020.0, 2010.0, 1479.5, 0.1, 0.02, 0.003, 0.0004)
    assert camera.model == fisheye
    assert camera.extra == {"locked": "0"}


def test_alicevision_older_versions(load_text):
    newest = params(load_text(sfm("1.2.13", pixelRatio="1")))
    assert params(load_text(sfm("1.2.3", pixelRatio="1.25")))["fy"] == 2000 / 1.25
    px = {"focalLength": None, "pixelRatio": None, "distortionType": None, "type": "fisheye4"}
    assert params(load_text(sfm("1.2.1", pxFocalLength=["2000", "2000"], **px))) == newest
    corner = {"principalPoint": ["2010.5", "1480"]}
    assert params(load_text(sfm("1.0.0", pxFocalLength="2000", **px, **corner))) == newest


def test_alicevision_equidistant_projects_as_its_source(load_text):
    text = sfm("1.2.13", type="equidistant", distortionType="radialk3", distortionParams=["0.1", "0.02", "-0.003"],
               fisheyeCircleRadius="1480", pixelRatio="1", sensorHeight="6.2")  # fmt: skip
    projected = load_text(text).project(POINTS)[0]
    focal_mm = 2000 * 8 / 4000
    theta, phi = np.arctan2(np.hypot(*POINTS.T[:2]), POINTS[:, 2]), np.arctan2(POINTS[:, 1], POINTS[:, 0])
    r = theta / (0.5 * (6.2 / focal_mm))
    r = r * (1 + 0.1 * r**2 + 0.02 * r**4 - 0.003 * r**6) * 1480
    expected = np.stack([r * np.cos(phi) + 2000 + 10.5, r * np.sin(phi) + 1500 - 20], -1)
    assert projected + 0.5 == pytest.approx(expected, abs=1e-9)


def test_alicevision_refuses_unsupported_cameras(load_text):
    with pytest.raises(FormatError, match=r"intrinsic 17: .*radialk3pt.*a pinhole has fisheye"):
        load_text(sfm("1.2.13", distortionType="radialk3pt"))
    with pytest.raises(FormatError, match="fisheye has 4 distortionParams"):
        load_text(sfm("1.2.13", distortionParams=["0.1"]))


# -- Metashape ------------------------------------------------------------------------------------------------------

METASHAPE = """<?xml version="1.0" encoding="UTF-8"?>
<!-- exported -->
<calibration>
  <projection>{kind}</projection>
  <width>3840</width>
  <height>2160</height>
  <f>1700.5</f>
  <cx>12.25</cx>
  <cy>-7.5</cy>
  <b1>2.5</b1>
  <k1>0.052014</k1>
  <k2>-0.0689641</k2>
  <k3>0.017671</k3>
  <p1>-0.00148237</p1>
  <p2>0.0018401</p2>
  <date>2024-05-01T10:00:00Z</date>
</calibration>
"""


def metashape(x, y, p1=-0.00148237, p2=0.0018401):
    """Return pixels by the user manual's appendix on camera models, from the plane."""
    r2 = x * x + y * y
    radial = 1 + 0.052014 * r2 - 0.0689641 * r2**2 + 0.017671 * r2**3
    xd = x * radial + p1 * (r2 + 2 * x * x) + 2 * p2 * x * y
    yd = y * radial + p2 * (r2 + 2 * y * y) + 2 * p1 * x * y
    return np.stack([3840 * 0.5 + 12.25 + xd * 1700.5 + xd * 2.5, 2160 * 0.5 - 7.5 + yd * 1700.5], -1)


def test_metashape_frame_and_fisheye_project_as_its_manual(load_text):
    x, y = (POINTS[:, :2] / POINTS[:, 2:]).T
    frame = load_text(METASHAPE.format(kind="frame"))
    assert frame.extra == {"date": "2024-05-01T10:00:00Z"}
    near = np.hypot(x, y) < 0.6
    assert frame.project(POINTS)[0][near] + 0.5 == pytest.approx(metashape(x, y)[near], abs=1e-9)
    r = np.hypot(x, y)
    x, y = x * np.arctan(r) / r, y * np.arctan(r) / r
    fisheye = load_text(METASHAPE.format(kind="fisheye"))
    assert fisheye.model.name == "thin_prism_fisheye"
    assert fisheye.project(POINTS)[0] + 0.5 == pytest.approx(metashape(x, y), abs=1e-9)
    plain = load_text(METASHAPE.format(kind="fisheye").replace("-0.00148237", "0").replace("0.0018401", "0"))
    assert plain.model.name == "kannala_brandt"
    assert plain.project(POINTS)[0] + 0.5 == pytest.approx(metashape(x, y, 0, 0), abs=1e-9)


def test_metashape_calibrations_inside_cameras_xml(load_text):
    size = '<resolution width="3840" height="2160"/>'
    one = '<calibration type="fisheye" class="{}">' + size + "<f>{}</f><k1>0.05</k1></calibration>"
    sensor = f'<sensor id="0" label="GoPro">{one.format("initial", 1600)}{one.format("adjusted", 1700)}</sensor>'
    camera = load_text(
        f'<?xml version="1.0"?><document version="2.0.0"><chunk><sensors>{sensor}</sensors></chunk></document>'
    )
    assert (camera.model.fx, camera.model.cx, camera.size) == (1700.0, 1919.5, (3840, 2160))


def test_metashape_sensors_that_were_not_adjusted_are_read(tmp_path):
    size = '<resolution width="3840" height="2160"/>'
    one = '<calibration type="fisheye" class="{}">' + size + "<f>{}</f><k1>0.05</k1></calibration>"
    sensors = [one.format("initial", 1600) + one.format("adjusted", 1700), one.format("initial", 1800)]
    text = "".join(f'<sensor id="{i}">{sensor}</sensor>' for i, sensor in enumerate(sensors))
    (tmp_path / "cameras.xml").write_text(f"<document><chunk><sensors>{text}</sensors></chunk></document>")
    assert [camera.model.fx for camera in load_all(tmp_path / "cameras.xml").values()] == [1700.0, 1800.0]


def test_metashape_refuses_unsupported_cameras(load_text):
    with pytest.raises(FormatError, match=r"frame with k4 = 0\.1 is not supported; calibrate with these fixed"):
        load_text(METASHAPE.format(kind="frame").replace("<b1>2.5</b1>", "<k4>0.1</k4>"))
    with pytest.raises(FormatError, match=r"projection 'cylindrical'.*is not supported"):
        load_text(METASHAPE.format(kind="cylindrical"))
    with pytest.raises(FormatError, match=r"positive.*got 0"):
        load_text(METASHAPE.format(kind="frame").replace("1700.5", "-2.5"))
    with pytest.raises(FormatError, match="DOCTYPE"):
        load_text("<!DOCTYPE a [<!ENTITY b 'c'>]>" + METASHAPE.format(kind="frame").partition("\n")[2])


# -- Hugin ----------------------------------------------------------------------------------------------------------

PTO = """# hugin project file
p f2 w3000 h1500 v360 E0 R0 n"TIFF_m c:LZW"
m i0
i w2000 h3000 f3 v110.5 Ra0 Rb0 a0.01 b-0.05 c0.02 d12.5 e-7.25 g0 t0 j0 r1.5 p-3 y20 S100,1900,200,2800 n"a b.jpg"
i w2000 h3000 f3 v=0 a=0 b=0 c=0 d=0 e=0 g=0 t=0 r91 p0 y-60.5 n"second.jpg"
v v0
c n0 N1 x1 y2 X3 Y4 t0
"""


def test_hugin_distortion_matches_panotools(load_text):
    camera = load_text(PTO)  # both images are by one camera
    assert camera.size == (2000, 3000)
    focal, radius = 1000 / np.radians(110.5 / 2), 1000.0
    theta, phi = np.arctan2(np.hypot(*POINTS.T[:2]), POINTS[:, 2]), np.arctan2(POINTS[:, 1], POINTS[:, 0])
    r = focal * theta / radius
    r = (0.01 * r**3 - 0.05 * r**2 + 0.02 * r + 1 - (0.01 - 0.05 + 0.02)) * r * radius
    expected = np.stack([r * np.cos(phi) + 999.5 + 12.5, r * np.sin(phi) + 1499.5 - 7.25], -1)
    assert camera.project(POINTS)[0] == pytest.approx(expected, abs=1e-9)
    assert (camera.extra["y"], camera.extra["r"], camera.extra["S"]) == (20.0, 1.5, "100,1900,200,2800")


@pytest.mark.parametrize(
    ("kind", "r"),
    [
        (0, lambda f, half: f * np.tan(half)),
        (2, lambda f, half: f * half),
        (8, lambda f, half: f * np.sin(half)),
        (10, lambda f, half: 2 * f * np.tan(half / 2)),
        (21, lambda f, half: 2 * f * np.sin(half / 2)),
    ],
)
def test_hugin_angle_of_view_spans_the_image_width(kind, r, load_text):
    camera = load_text(f'i w800 h600 f{kind} v100 r0 p0 y0 a0 b0 c0 d0 e0 n"x.png"\n')
    half = np.radians(50)
    assert camera.project([np.sin(half), 0, np.cos(half)])[0] == pytest.approx([399.5 + 400, 299.5], abs=1e-9)
    assert r(camera.model.fx, half) == pytest.approx(400)


def test_hugin_refuses_unsupported_cameras(load_text):
    line = 'i w800 h600 f0 v80 a0 b0 c0.01 d0 e0 g0 t0 r0 p0 y0 n"x.png"'
    with pytest.raises(FormatError, match=r"image 0: f0 with a = 0, b = 0, c = 0\.01 is not supported"):
        load_text(line)
    with pytest.raises(FormatError, match="a shear"):
        load_text(line.replace("g0", "g3"))
    with pytest.raises(FormatError, match=r"v=7 refers to an image that does not exist"):
        load_text(line.replace("v80", "v=7"))
    with pytest.raises(FormatError, match=r"projection f1 is not supported"):
        load_text(line.replace("f0", "f1"))


def test_hugin_has_one_focal_length(tmp_path):
    lens = model_class("equidistant")
    notes = save(Camera(lens(300.0, 300.2, 400.0, 300.0), (800, 600)), tmp_path / "x.pto", format="hugin").notes
    assert "their mean is written" in notes[0]
    with pytest.raises(FormatError, match="one focal length and this camera has two, 300 and 310"):
        save(Camera(lens(300.0, 310.0, 400.0, 300.0), (800, 600)), tmp_path / "y.pto", format="hugin")


# -- KITTI-360: image_02.yaml ---------------------------------------------------------------------------------------

KITTI = """%YAML:1.0
---
model_type: MEI
camera_name: image_02
image_width: 1400
image_height: 1400
mirror_parameters:
   xi:2.2134047507854890e+00
distortion_parameters:
   k1:1.6798235660113681e-02
   k2:1.6548773243373522e+00
   p1: 4.2223943394772046e-04
   p2: 4.2462134260997584e-04
projection_parameters:
   gamma1: 1.3363220825849971e+03
   gamma2: 1.3357883350012958e+03
   u0: 7.1694323510126321e+02
   v0: 7.0576498308221585e+02
"""


def test_kitti_360_without_a_space_after_the_colon(load_text):
    camera = load_text(KITTI)
    assert camera.model.name == "mei"
    assert params(camera)["xi"] == 2.2134047507854890
    assert camera.provenance["format"] == "camodocal"
