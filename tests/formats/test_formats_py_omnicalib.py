"""py-omnicalib's calibration.yml against the formula of the program and the board of its sample."""

import numpy as np
import pytest
import yaml

from omnisight.camera import Camera
from omnisight.conversion import rank_conversions
from omnisight.formats import FormatError, load, save
from omnisight.models import model_class

TEXT = """poly_incident_angle_to_radius:
- 0.0
- 562.5
- -11.96
- 26.78
- -12.01
poly_radius_to_z:
- 561.4
- 0.0
- -0.0006
principal_point:
- 1280.46
- 1031.58
"""


def project(bearings, data):
    """Return the pixels of bearings as py-omnicalib's project_poly_thetar computes them."""
    flat = np.hypot(bearings[:, 0], bearings[:, 1])
    radius = np.polynomial.polynomial.polyval(np.arctan2(flat, bearings[:, 2]), data["poly_incident_angle_to_radius"])
    return bearings[:, :2] / flat[:, None] * radius[:, None] + data["principal_point"]


BEARINGS = np.random.default_rng(5).normal((0, 0, 1), size=(50, 3))


def test_pixels_match_the_formula_of_the_program(load_text):
    camera = load_text(TEXT)
    pixels, valid = camera.project(BEARINGS)
    assert valid.sum() > 40
    assert pixels[valid] == pytest.approx(project(BEARINGS, yaml.safe_load(TEXT))[valid], abs=1e-9)
    assert camera.size == (0, 0)


def test_the_sample_explains_the_corners_of_its_images(data):
    """The program states 0.354 px for the poses and corners that it used."""
    import omnisight as om

    folder = data("kaidan_catadioptric")
    camera = load(folder / "example_calibration.yml")
    assert len(camera.extra["extrinsics"]) == 16
    (evaluation,) = om.evaluate(camera, folder, om.EvaluateOptions(pattern="11x7", square="30mm")).values()
    assert evaluation.statistics().rms < 0.354


def test_both_polynomials_that_are_written_agree_with_the_camera(tmp_path):
    model = model_class("radial_polynomial").example()
    camera = Camera(model.with_values({"fy": model.fx}), (960, 962), theta_max=2.0)
    save(camera, tmp_path / "calibration.yml", format="py_omnicalib")
    data = yaml.safe_load((tmp_path / "calibration.yml").read_text())
    bearings, pixels = camera.samples()
    off_axis = bearings[:, 2] < 1 - 1e-9
    assert project(bearings[off_axis], data) == pytest.approx(pixels[off_axis], abs=1e-9)
    offset = pixels - data["principal_point"]
    z = np.polynomial.polynomial.polyval(np.hypot(*offset.T), data["poly_radius_to_z"])
    lifted = camera.project(np.column_stack([offset, z]))[0]
    assert np.linalg.norm(lifted - pixels, axis=1).max() < 0.02


def test_a_conversion_names_the_missing_image_size(load_text):
    with pytest.raises(ValueError, match="the image size is not known"):
        rank_conversions(load_text(TEXT), ["kannala_brandt", "mei"])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("- 562.5\n", "- 562.5\n- 1.0\n", r"2 to 5 coefficients, got 6.*degree 4"),
        ("- 0.0\n- 562.5", "- 3.0\n- 562.5", r"radius on the axis, must be 0, got 3"),
        ("- 562.5", "- -562.5", r"must be positive"),
        ("- 1031.58\n", "", r"principal_point must be a list of 2 numbers"),
    ],
)
def test_files_that_no_camera_has_are_refused(load_text, old, new, message):
    with pytest.raises(FormatError, match=message):
        load_text(TEXT.replace(old, new, 1))
