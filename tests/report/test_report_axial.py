"""The report of a non-central camera: every section is about that camera."""

import base64
import re
from dataclasses import replace

import numpy as np
import pytest

from noncentral import SIZE, off_focus
from notebook_html import assert_html
from omnisight.formats import load, save
from omnisight.optics.models.axial import Axial
from omnisight.ray_camera import RayCamera
from omnisight.report.number_format import format_with_sigma
from omnisight.report.page import render_page
from omnisight.report.sections.images import residual_scale
from omnisight.simulation import fisheye_setup
from reporting import (
    NAMES,
    PUPIL,
    calibrate_detections,
    contains_nan,
    embedded_json,
    report_data,
    section,
    simulate_detections,
    with_observations,
    with_quality,
)


@pytest.fixture(scope="module")
def text(axial_report):
    return axial_report.read_text("utf-8")


def test_verdict_and_key_figures(text, axial):
    c = axial.calibration
    head = text[text.index("<header>") : text.index("<nav")]
    assert f"Camera calibration: axial with lens model {axial.camera.model.lens.name}" in head
    assert f">{c.held_out_rms:.2g} px<" in head
    assert f">{c.rms:.2g} px<" in head
    assert f"mean {c.mean:.3f} px" in head
    assert f"outliers: {int(c.outliers.sum())}<" in head
    shift = axial.pupil_shift
    length, sigma = format_with_sigma(1e3 * shift.length, 1e3 * shift.length_sigma)
    assert f">{length} mm<" in head
    assert f">± {sigma} mm along the axis" in head
    for reason in c.verdict.reasons:
        assert reason in text


def test_embedded_json_contains_camera_and_poses(text, axial):
    data, c = embedded_json(text), axial.calibration
    assert data["camera"]["params"] == axial.camera.model.to_dict()
    assert data["verdict"] == str(c.verdict)
    assert data["candidates"] == [candidate.as_dict() for candidate in c.candidates]
    assert len(data["images"]) > 10
    for k, image in enumerate(data["images"][:10]):
        np.testing.assert_array_equal(image["cam_from_board"][0]["translation"], c.state.translations[k])
        rows = c.observations.groups[k]
        assert image["rms"] == pytest.approx(np.sqrt((c.residual_lengths[rows] ** 2).mean()))


def test_residuals_over_images_are_those_of_the_camera(text, axial):
    paths = re.findall(r'd="([^"]*)" class="residual inlier"', text)
    lines = re.findall(r"M(\S+) (\S+?)l(\S+) (\S+?)(?=M|$)", paths[1])
    rows = axial.observations.groups[1]
    residuals = axial.residuals[rows][~axial.outliers[rows]]
    np.testing.assert_allclose(np.array(lines, float)[:, 2:] / residual_scale(axial), residuals, atol=0.01)


def test_residuals_are_decomposed_at_the_ray_of_each_corner(axial):
    radial, tangential = axial.radial_and_tangential
    np.testing.assert_allclose(np.hypot(radial, tangential), axial.residual_lengths, rtol=1e-9)
    points = axial.state.points(axial.observations)[0]
    origin = axial.camera.model.pupil_z(axial.theta)
    # Seen from the origin of its ray, the corner is at the angle of the ray.
    angle = np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2] - origin)
    np.testing.assert_allclose(axial.theta, angle, atol=1e-6)


def test_entrance_pupil_shift_is_drawn(text, axial):
    drawn, shift = section(text, "pupil-shift"), axial.pupil_shift
    assert "How to read this" in drawn
    assert f"by {axial.format_length(shift.length, shift.length_sigma)}" in drawn
    assert re.search(r"by [\d.]+ ± [\d.]+ mm", drawn)
    truth = RayCamera(Axial(axial.camera.model.lens, PUPIL), axial.camera.size)
    field = axial.camera.theta_min, axial.max_theta
    assert abs(shift.length - truth.model.pupil_shift(*field)) < 5 * shift.length_sigma
    distances = np.linalg.norm(axial.state.points(axial.observations)[0], axis=1)
    near, far = map(float, re.search(r"Corner distances: (\S+) mm to (\S+) mm", drawn).groups())
    assert 1e3 * distances.min() * 0.99 <= near < far <= 1e3 * distances.max() * 1.01


def test_held_out_error_is_compared_with_the_best_central_camera(text, axial):
    drawn, c = section(text, "models"), axial.calibration
    assert f"central {c.central.name}" in drawn
    assert f"{c.central.held_out_rms:.4f}" in drawn
    assert f"{c.held_out_rms:.4f}" in drawn
    assert c.selection.reason in drawn
    test_section = section(text, "noncentral-test")
    assert f"{c.held_out_rms:.3f} px with an entrance pupil shift" in test_section
    assert "--model axial" not in test_section


def test_export_at_a_distance_is_recommended_if_the_camera_is_noncentral(axial):
    test = replace(axial.noncentral_test, is_noncentral=True)
    text = section(render_page(with_quality(axial, noncentrality=test)), "noncentral-test")
    assert "omnisight convert --distance" in text
    assert "Use the central camera" not in text


def test_central_camera_is_recommended_if_it_is_sufficient(axial):
    test = replace(axial.noncentral_test, is_noncentral=False, doubt="")
    text = render_page(with_quality(axial, noncentrality=test))
    name = axial.calibration.central.state.model.name
    assert f"Use the central camera, --model {name}" in section(text, "noncentral-test")


def test_uncertainty_is_that_of_the_cameras_covariance(text, axial):
    pixels, _, theta, _ = axial.uncertainty.worst()
    assert f"The largest values are {pixels:.2g} px" in section(text, "uncertainty")
    assert theta <= axial.max_theta + 1e-9
    np.testing.assert_array_equal(axial.camera.central_limit.covariance, axial.camera.covariance)


def test_only_formats_that_support_rays_are_offered(text, axial, tmp_path):
    drawn = section(text, "downloads")
    ((content, name),) = re.findall(r'href="data:[^,"]*,([^"]*)" download="[^"]*" data-format="(\w+)"', drawn)
    assert name == "native"
    file = tmp_path / "camera.json"
    file.write_bytes(base64.b64decode(content))
    np.testing.assert_array_equal(load(file).model.params, axial.camera.model.params)
    np.testing.assert_array_equal(load(file).covariance, axial.camera.covariance)
    assert "omnisight convert camera.json --to opencv --distance 2m" in drawn


def test_commands_for_central_cameras_are_not_recommended(text):
    assert "omnisight next" not in text
    assert "--model spline" not in text


def test_lengths_are_in_squares_if_the_square_size_is_unknown(axial):
    data = with_quality(with_observations(axial, unit="squares"), noncentrality=None)
    camera = replace(axial.camera, unit="squares")
    text = render_page(replace(data, calibration=replace(data.calibration, camera=camera)))
    assert re.search(r"by [\d.]+ ± [\d.]+ squares", section(text, "pupil-shift"))
    assert " mm" not in text[text.index("<main>") : text.index('<script type="application/json"')]


def test_report_of_a_mirror_camera_refined_from_its_design(tmp_path):
    """The camera is not axial, so there is no section about the entrance pupil shift."""
    truth = off_focus()
    small = replace(truth, system=truth.system.rescaled(640 / SIZE[1]))
    detections = simulate_detections(tmp_path, project=small.project)
    design = RayCamera(small.system, detections.size, unit="m", theta_max=np.radians(100))
    save(design, tmp_path / "design.json")
    data = report_data(calibrate_detections(detections, start=tmp_path / "design.json"))
    text = render_page(data)
    ids = " ".join(re.findall(r'<section id="([\w-]+)"', text))
    assert ids == "verdict images coverage profile uncertainty residuals models board-poses parameters downloads"
    assert embedded_json(text)["camera"]["params"] == data.camera.model.to_dict()
    assert "mirror_tz" in section(text, "parameters")
    # The angle from the axis grows with the distance from the centre of the mirror's image.
    centre = small.system.lens.project([0.0, 0.0, 1.0])[0]
    radius = np.linalg.norm(data.observations.pixels - centre, axis=1)
    assert np.corrcoef(radius[data.inliers], data.theta[data.inliers])[0, 1] > 0.95
    assert not contains_nan(text)


@pytest.mark.parametrize("count", [1, 2])
def test_report_of_one_or_two_images(count, tmp_path):
    camera = Axial(fisheye_setup(640).camera.model, PUPIL)
    detections = simulate_detections(tmp_path, count=count, unused=False, project=camera.project)
    calibration = calibrate_detections(detections, NAMES[:count], model="axial", force=True)
    text = render_page(report_data(calibration))
    assert embedded_json(text)["verdict"] == str(calibration.verdict) == "do not use"
    assert "The reference is a spline" not in section(text, "models")
    assert not contains_nan(text)


def test_the_calibration_is_shown_in_notebooks_with_its_profile(axial):
    assert_html(axial.calibration, str(axial.calibration.verdict), "axial, non-central")
