"""omnisight design mirror."""

import json
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from cli_scene import file_names

import omnisight as om
from omnisight.formats import load
from omnisight.optics import mirror_class
from omnisight.optics.design.shapes import KINDS

FIELD = ("--hfov", 360, "--up", 20, "--down", 60)
WITHIN = {"conical": ("--up", 20, "--down", 10), "parabolic": FIELD}


@pytest.fixture
def design(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: run("design", "mirror", *arguments)


@pytest.fixture
def cannot(refuses, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: refuses("design", "mirror", *arguments)


def test_report_has_all_dimensions(design, tmp_path):
    status, out, err = design(*FIELD)
    assert (status, err) == (0, "")
    for output in (
        "mirror     hyperboloid with the lens in its far focus",
        "shape      convex, vertex radius 17.9302 mm, eccentricity 1.28171, conic constant -1.64279 (a 27.89",
        "surface    z = rho²/(17.9302·(1 + √(1 + 0.00199939·rho²))) mm",
        "rim        diameter 60 mm, sag 18.7773 mm, at half the radius 5.69333 mm",
        "hole       diameter 8.498 mm",
        "lens       focal length 4.847 mm, 40.0 degrees across the mirror; entrance pupil 63.65 mm from",
        "viewpoint  7.858 mm above the vertex, single",
        "field      from 20.0 degrees above the horizon to 60.0 below it, 360 around",
        "blind spot 30.0 degrees around straight down, 171 px across: the hole of the mirror",
        "image      941 px across, 98 % of the shorter side; sensor 1280x960 px of 3.75 um",
        "tolerances axial position ±2.6 mm, lateral position ±0.57 mm, tilt ±0.42°, surface slope ±0.81′",
        "model      unified, xi 0.96997, gamma 314.35 px",
        "tilt 1°",
        "parallax px at 1 m",
    ):
        assert output in out
    assert file_names(tmp_path) == []


@pytest.mark.parametrize(
    ("down", "field"), [(50, "50.0 below"), (0, "0.0 below"), (-5, "5.0 above"), (78, "78.0 below")]
)
def test_down_is_the_lower_limit_of_the_field(design, tmp_path, down, field):
    status, out, _ = design("--up", 20, f"--down={down}", "--camera", "camera.json")
    assert status == 0
    assert f"field      from 20.0 degrees above the horizon to {field} it" in out
    assert np.degrees(load(tmp_path / "camera.json").theta_min) == pytest.approx(90 - down, abs=0.1)


def test_drawing_has_the_dimensions_a_workshop_needs(design, tmp_path):
    assert design(*FIELD, "-o", "mirror.svg")[0] == 0
    root = ElementTree.parse(tmp_path / "mirror.svg").getroot()
    assert (root.get("width"), root.get("height")) == ("297mm", "210mm")
    words = " ".join(root.itertext())
    dimensions = ("18.78 mm", "7.858 mm", "63.65 mm", "hole 8.498 mm", "20 mm")
    surface = ("z = ρ²/(17.9302·(1 + √(1 + 0.00199939·ρ²)))", "30.000", "18.7773", "45.000°")
    tolerances = ("axial position", "±2.6 mm", "surface slope", "at 1 m")
    block = ("1:1 on A4, dimensions in mm", "Hyperbolic mirror, Ø60 mm, depth 18.78 mm", f"omnisight {om.__version__}")
    for text in (*dimensions, *surface, *tolerances, *block):
        assert text in words, text


@pytest.mark.parametrize("kind", KINDS)
def test_dxf_has_the_profile_in_millimetres(design, tmp_path, kind):
    """Lines alternate between group codes and values; code 10 is x, 20 is y."""
    numbers = json.loads(design("--kind", kind, *WITHIN.get(kind, FIELD), "-o", "mirror.dxf", "--json")[1])
    lines = (tmp_path / "mirror.dxf").read_text(encoding="ascii").splitlines()
    tags = list(zip(lines[::2], lines[1::2], strict=True))
    assert tags[-1] == ("  0", "EOF")
    at = [i for i, tag in enumerate(tags) if tag == ("  0", "VERTEX")]
    points = 1e-3 * np.array([[float(tags[i + 2][1]), float(tags[i + 3][1])] for i in at])
    mirror = mirror_class("cone" if kind == "conical" else "conic")(**numbers["mirror"])
    np.testing.assert_allclose(points[:, 1], mirror.sag(np.abs(points[:, 0])), atol=1e-9)
    assert np.abs(points[:, 0]).max() == pytest.approx(mirror.rim)
    assert np.abs(points[:, 0]).min() == pytest.approx(mirror.hole, abs=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_reported_drawn_and_printed_as_json(design, tmp_path, kind):
    field = WITHIN.get(kind, FIELD)
    status, out, err = design("--kind", kind, *field, "-o", "mirror.svg")
    assert (status, err) == (0, "")
    assert "written    mirror.svg" in out
    root = ElementTree.parse(tmp_path / "mirror.svg").getroot()
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    words = " ".join(root.itertext())
    for output in ("20.0 degrees above the horizon", "60 mm", "20° up", "viewpoint", "px per degree", "blind"):
        assert output in words
    assert "nan" not in (tmp_path / "mirror.svg").read_text()
    status, out, err = design("--kind", kind, *field, "--json", "-o", "mirror.svg")
    assert (status, err) == (0, "")
    numbers = json.loads(out)
    assert (numbers["kind"], numbers["up_deg"]) == (kind, pytest.approx(20))
    assert numbers["viewpoint"]["single"] is KINDS[kind].central
    assert (numbers["model"] is None) is not KINDS[kind].central
    assert numbers["resolution"][0]["elevation_deg"] == pytest.approx(20)
    assert numbers["resolution"][0]["radius_px"] == pytest.approx(numbers["circle_px"], rel=1e-6)
    assert {row["description"] for row in numbers["misalignments"]} >= {"as designed", "1 mm lateral", "tilt 0.1°"}


def test_lengths_have_units(design):
    given = ("--pixel", "3 um", "--focal", "8mm", "--diameter", "5cm", "--working-distance", "2m", "--body", "1in")
    numbers = json.loads(design(*FIELD, "--sensor", "1920x1080", *given, "--json")[1])
    assert numbers["focal"] == 0.008
    assert numbers["mirror"]["rim"] == pytest.approx(0.025)
    assert numbers["working_distance"] == 2.0
    assert numbers["circle_px"] == pytest.approx(0.98 * 540)


@pytest.mark.parametrize("kind", ["hyperbolic", "parabolic"])
def test_camera_file_matches_the_design(design, tmp_path, kind):
    status, out, _ = design("--kind", kind, *FIELD, "--camera", "camera.json")
    assert status == 0
    assert "written    camera.json (try: omnisight view IMAGE --camera camera.json --up back)" in out
    camera = load(tmp_path / "camera.json")
    assert camera.size == (1280, 960)
    assert (camera.model.name, camera.model.fx < 0 < camera.model.fy) == ("unified", True)
    assert np.degrees(camera.theta_max) == pytest.approx(110)
    assert np.degrees(camera.theta_min) == pytest.approx(30, abs=1e-6)
    # The rim is on the image's circle, and the horizon, ahead, is above the middle in an upright view of it.
    (pixel,), _ = camera.project([[np.sin(camera.theta_max), 0, np.cos(camera.theta_max)]])
    assert abs(pixel[0] - 639.5) == pytest.approx(0.98 * 480, rel=1e-9)


@pytest.mark.parametrize("kind", ["spherical", "conical"])
def test_non_central_design_is_written_with_lens_and_mirror(design, tmp_path, kind):
    status, out, err = design("--kind", kind, *WITHIN.get(kind, FIELD), "--camera", "camera.json")
    assert (status, err) == (0, "")
    assert "written    camera.json (try: omnisight simulate room --camera camera.json)" in out
    camera = load(tmp_path / "camera.json")
    assert (type(camera), camera.model.name, camera.size) == (om.RayCamera, "catadioptric", (1280, 960))
    # Angles are from the lens' axis, up into the mirror: the rim shows 20 degrees above the horizon.
    assert np.degrees(camera.theta_min) == pytest.approx(70)
    rim = camera.rays([639.5 + 0.98 * 480 * (1 - 1e-9), 479.5])
    assert np.degrees(np.arctan2(rim.bearings[0], rim.bearings[2])) == pytest.approx(70, abs=1e-5)
    points = rim.origins + 2.0 * rim.bearings
    np.testing.assert_allclose(camera.project(points)[0], [639.5 + 0.98 * 480, 479.5], atol=1e-5)


def test_view_unrolls_an_image_of_the_designed_camera(design, run, tmp_path):
    """An image that shows each direction's elevation in red and azimuth in green, through the camera file and view."""
    assert design(*FIELD, "--sensor", "640x480", "--camera", "camera.json")[0] == 0
    camera = load(tmp_path / "camera.json")
    u, v = np.meshgrid(np.arange(640), np.arange(480))
    bearings, valid = camera.unproject(np.stack([u, v], -1))
    elevation = np.degrees(np.arctan2(-bearings[..., 2], np.hypot(bearings[..., 0], bearings[..., 1])))
    image = np.zeros((480, 640, 3), np.uint8)
    image[..., 0] = np.where(valid, np.clip(128 + 2 * np.nan_to_num(elevation), 0, 255), 0)
    om.write_image(tmp_path / "image.png", image)
    view = ("--to", "cylinder", "--up", "back", "--elevation=-40:15", "-o", "around.png")
    status, _, err = run("view", "image.png", "--camera", "camera.json", *view)
    assert (status, err) == (0, "")
    around = om.read_image(tmp_path / "around.png")[..., 0].astype(float)
    top, bottom = around[2].mean(), around[-3].mean()
    assert top == pytest.approx(128 + 2 * 15, abs=4)
    assert bottom == pytest.approx(128 - 2 * 40, abs=4)
    assert around[2].std() < 3


@pytest.mark.parametrize(
    ("arguments", "output"),
    [
        (("--hfov", 270), "a mirror of revolution shows 360 degrees: leave it out, and crop the panorama"),
        (("--up", 80), "no mirror shows more than 70.0 degrees up, --up is 80: reduce --up, or use a longer"),
        (
            ("--down", 85),
            "the camera body hides everything more than 78.1 degrees below the horizon, --down is 85: reduce",
        ),
        (
            ("--kind", "round"),
            "unknown kind of mirror 'round'; there are: hyperbolic, parabolic, spherical, conical",
        ),
        (
            ("--kind", "conical", "--focal", "8mm"),
            "the field of a cone equals the half angle of its lens, 12.4 degrees here, but the field is 80",
        ),
        (("--kind", "parabolic", "--focal", "8mm"), "leave the focal length out, or choose a hyperbolic mirror"),
        (("--pixel", "3.75mm"), "the pixel is 0.00375 m, more than 0.0001 m: check its unit"),
        (("--focal", "8"), "--focal: the length '8' has no unit: write 8mm"),
        (("--pixel", "big"), "--pixel: cannot read the length 'big'"),
        (("--pixel", "0um"), "--pixel: the length"),
        (("--sensor", "wide"), "--sensor must be WIDTHxHEIGHT in px"),
        (("--sensor", "8x8"), "sensor of 8x8 px: width and height must be from 16"),
        (("--diameter", "6cm", "--distance", "6cm", "--focal", "25mm"), "px wide, the sensor 960 px: use 4.625mm"),
        (("-o", "mirror.png"), "is written as .svg or .dxf; name it mirror.svg or mirror.dxf"),
        (("-o", "none/mirror.svg"), "there is no folder none; make it first"),
        (("--camera", "camera.yaml"), "is written as .json; name it camera.json"),
    ],
)
def test_impossible_designs_are_rejected_and_write_nothing(cannot, tmp_path, arguments, output):
    assert output in cannot(*arguments)
    assert file_names(tmp_path) == []


def test_only_mirrors_are_designed(run):
    assert run("design", "lens")[0] == 2
