"""Cameras of rays: what they give, and the files that hold them."""

import dataclasses
import json

import numpy as np
import pytest

import omnisight as om
from noncentral import SIZE, in_focus, off_focus
from omnisight.formats import FormatError, format_names, load_all
from omnisight.geometry.sphere import angle_from_axis
from omnisight.models.kannala_brandt import KannalaBrandt
from omnisight.optics import Catadioptric
from omnisight.optics.models.axial import Axial

CAMERA = om.RayCamera(
    Axial.example(),
    (960, 962),
    theta_max=np.pi / 2,
    theta_min=np.pi / 12,
    calibration={"rms": 0.2},
    covariance=np.diag(np.arange(10.0)),
    provenance={"tool": "a test"},
    extra={"owner": "nobody"},
)
PIXELS = np.random.default_rng(1).uniform(0, 960, (60, 2))


def test_points_at_a_distance_project_to_their_pixels():
    for distance in (0.05, 1.0, 30.0):
        points, valid = CAMERA.points_at(PIXELS, distance)
        assert valid.any()
        np.testing.assert_allclose(np.linalg.norm(points[valid], axis=1), distance)
        np.testing.assert_allclose(CAMERA.project(points[valid])[0], PIXELS[valid], atol=1e-8)


def test_a_distance_inside_the_camera_has_no_points():
    far = om.RayCamera(Axial(KannalaBrandt.example(), (1.0,)), (960, 962))
    points, valid = far.points_at([[470.0, 480.0], [950.0, 480.0]], 0.3)
    assert valid.tolist() == [True, False]
    assert np.isnan(points[1]).all()


def test_in_image_includes_half_a_pixel_at_the_edges():
    assert CAMERA.in_image([[-0.5, -0.5], [959.49, 961.49]]).all()
    assert not CAMERA.in_image([[-0.51, 0], [0, 961.5], [np.nan, 3.0]]).any()


def test_scaled_keeps_the_rays():
    half = CAMERA.scaled(0.5)
    assert half.size == (480, 481)
    rays, again = CAMERA.rays(PIXELS), half.rays((PIXELS + 0.5) / 2 - 0.5)
    np.testing.assert_allclose(again.bearings, rays.bearings, atol=1e-12)
    np.testing.assert_allclose(again.origins, rays.origins, atol=1e-12)


@pytest.mark.parametrize("distance", [0.2, 1.0, np.inf])
def test_a_central_camera_agrees_only_at_its_distance(distance):
    central, error = CAMERA.central(distance)
    assert error < 0.02
    assert central.model.name == "kannala_brandt"
    assert (central.size, central.theta_min, central.theta_max) == (CAMERA.size, CAMERA.theta_min, CAMERA.theta_max)
    assert central.provenance["central_of"]["differs_px"] == error
    for away in (0.2, 1.0, 1e6):
        points, valid = CAMERA.points_at(PIXELS, away)
        cone = valid & (np.abs(angle_from_axis(CAMERA.rays(PIXELS).bearings) - 0.9) < 0.6)
        off = np.linalg.norm(central.project(points[cone])[0] - PIXELS[cone], axis=1)
        if min(away, 1e6) == min(distance, 1e6):
            assert off.max() < 0.02
        else:
            assert off.max() > 0.5


def test_a_central_camera_of_a_given_model():
    central, error = CAMERA.central(1.0, "double_sphere")
    assert central.model.name == "double_sphere"
    assert error < 0.5


def test_a_mirror_in_focus_is_the_unified_model_at_every_distance():
    """From its viewpoint, and as in its image: z to where the mirror looks, left and right exchanged."""
    camera = om.RayCamera(in_focus().system, SIZE)
    lens, turned = in_focus().system.lens, np.array([1.0, 1.0, -1.0])
    for distance in (0.2, np.inf):
        central, error = camera.central(distance, "unified")
        assert error < 1e-6
        assert central.model.cx == pytest.approx(lens.cx, abs=1e-6)
        origins, bearings, valid = camera.rays(PIXELS)
        focus = np.array([0.0, 0.0, 2 * 0.0385])
        points = (origins + 3 * bearings - focus)[valid] * turned
        np.testing.assert_allclose(central.project(points)[0], PIXELS[valid], atol=1e-6)


def test_a_misaligned_mirror_has_a_central_camera():
    camera = om.RayCamera(off_focus().system, SIZE, theta_min=1.2, theta_max=2.9)
    central, error = camera.central(2.0, "kannala_brandt")
    assert error < 0.02
    np.testing.assert_allclose((central.theta_min, central.theta_max), (np.pi - 2.9, np.pi - 1.2))
    assert central.provenance["central_of"]["mirrored"]


@pytest.mark.parametrize("distance", [0, -1.0, np.nan, 1e200])
def test_an_invalid_distance_is_rejected(distance):
    with pytest.raises(ValueError, match="distance must be positive"):
        CAMERA.central(distance)
    with pytest.raises(ValueError, match="distance must be a positive length"):
        CAMERA.points_at(PIXELS, distance)


def test_a_camera_without_central_approximation_is_rejected_with_a_reason():
    with pytest.raises(ValueError, match="of 1089 pixels all over the image see a point 1e-09 away"):
        CAMERA.central(1e-9)
    with pytest.raises(ValueError, match="the image size is unknown"):
        dataclasses.replace(CAMERA, size=(0, 0)).central(1.0)


def test_an_invalid_size_is_rejected():
    with pytest.raises(ValueError, match="size must be"):
        om.RayCamera(Axial.example(), (-1, 4))
    with pytest.raises(ValueError, match="unit must be m or squares, got 'feet'"):
        om.RayCamera(Axial.example(), (4, 4), unit="feet")


@pytest.mark.parametrize("model", [Axial.example(), Catadioptric.example()], ids=lambda model: model.name)
def test_a_file_preserves_the_camera(model, tmp_path):
    camera = dataclasses.replace(CAMERA, model=model, covariance=None, unit="squares")
    written = om.save(camera, tmp_path / "camera.json")
    assert written.error_px == 0
    again = om.load(tmp_path / "camera.json")
    assert isinstance(again, om.RayCamera)
    assert again == camera
    units = json.loads((tmp_path / "camera.json").read_text("utf-8"))["units"].values()
    assert "squares" in units
    assert "m" not in units


def test_a_file_preserves_the_covariance(tmp_path):
    om.save(CAMERA, tmp_path / "camera.json")
    np.testing.assert_array_equal(om.load(tmp_path / "camera.json").covariance, CAMERA.covariance)


@pytest.mark.parametrize("name", [name for name in format_names() if name != "native"])
def test_other_formats_reject_it_with_advice(name, tmp_path):
    with pytest.raises(FormatError, match=r"this one is non-central \(axial\).*--distance"):
        om.save(CAMERA, tmp_path / "camera", format=name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"model": "nonsense"}, "unknown non-central camera 'nonsense'; there are: axial"),
        ({"model": "kannala_brandt"}, "unknown non-central camera"),
        ({"length_unit": "feet"}, "length_unit must be m or squares, got 'feet'"),
        ({"version": 99}, "version 99"),
        ({"size": [3]}, "size"),
        ({"params": {}}, "missing lens"),
        ({"params": {"lens": "kannala_brandt", "pupil0": None}}, "pupil0 must be a number"),
        ({"params": {"lens": "kannala_brandt"}}, "missing pupil0"),
        ({"params": {"lens": "../evil", "pupil0": 0.0}}, "unknown camera model"),
        ({"params": 3}, '"params" must be an object, got 3'),
        ({"params": {f"k{i}": 0 for i in range(3000)}}, "3000 parameters; a camera has at most 2000"),
        ({"model": "catadioptric", "params": {f"mirror{i}": "plane" for i in range(40)}}, "40 lenses and mirrors"),
        ({"model": 3}, '"model" must be the name of a model, got 3'),
        ({"model": "x" * 10**5}, '"model" must be the name of a model, got \'x{50,60}$'),
        ({"covariance": [[1.0]]}, "covariance must have 10 rows"),
        ({"theta_max_deg": 1e9}, "theta_max_deg"),
        ({"format": "omnisight-nonsense"}, "'omnisight-nonsense'"),
    ],
)
def test_a_damaged_file_is_rejected_with_a_reason(change, said, tmp_path):
    om.save(CAMERA, tmp_path / "camera.json")
    data = json.loads((tmp_path / "camera.json").read_text())
    (tmp_path / "camera.json").write_text(json.dumps(data | change))
    with pytest.raises(FormatError, match=said):
        load_all(tmp_path / "camera.json")


def test_the_field_of_view_is_that_of_a_distant_scene():
    assert CAMERA.fov == pytest.approx(CAMERA.central(np.inf)[0].fov, abs=0.01)
    assert CAMERA.focal == pytest.approx(om.Camera(CAMERA.model.lens, CAMERA.size).focal)
    with pytest.raises(AttributeError, match=r"use camera\.central\(distance\)\[0\]\.K"):
        _ = CAMERA.K
    assert not hasattr(CAMERA, "K")
