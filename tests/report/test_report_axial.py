"""The report of a camera whose rays do not meet in a point: all of it is about that camera."""

import base64
import re
from dataclasses import replace

import numpy as np
import pytest
from reporting import COMMAND, NAMES, PUPIL, calibrated, data_of, seen

from noncentral import SIZE, off_focus
from omnisight.formats import load
from omnisight.optics.models.axial import Axial
from omnisight.pipeline.noncentral import calibrate_rays
from omnisight.quality.central_limit import far_camera
from omnisight.ray_camera import RayCamera
from omnisight.report.report_data import Material
from omnisight.report.number_format import with_sigma
from omnisight.report.page import page
from omnisight.report.sections.images import exaggeration
from omnisight.simulation import fisheye_setup
from omnisight.targets import Checkerboard


@pytest.fixture(scope="module")
def text(axial_report):
    return axial_report.read_text("utf-8")


def part(text, name):
    return re.search(rf'<section id="{name}".*?</section>', text, re.DOTALL)[0]


def test_the_verdict_and_the_figures_at_the_head_are_its_own(text, axial):
    c = axial.calibration
    head = text[text.index("<header>") : text.index("<nav")]
    assert f"Camera calibration: axial, its lens {axial.camera.model.lens.name}" in head
    assert f">{c.held_out_rms:.2g} px<" in head
    assert f">{c.rms:.2g} px<" in head
    assert f"the mean is {c.mean:.3f} px" in head
    assert f"{int(c.outliers.sum())} of them doubtful" in head
    length, sigma = with_sigma(1e3 * axial.travel.length, 1e3 * axial.travel.length_sigma)
    assert f">{length} mm<" in head
    assert f">± {sigma} mm along the axis" in head
    for reason in c.verdict.reasons:
        assert reason in text


def test_a_machine_reads_that_camera_and_its_poses_from_it(text, axial):
    data, c = data_of(text), axial.calibration
    assert data["camera"]["params"] == axial.camera.model.to_dict()
    assert data["verdict"] == str(c.verdict)
    assert data["candidates"] == [candidate.as_dict() for candidate in c.candidates]
    for k, picture in enumerate(data["images"][:10]):
        np.testing.assert_array_equal(picture["cam_from_board"][0]["translation"], c.state.translations[k])
        rows = c.views.groups[k]
        assert picture["rms"] == pytest.approx(np.sqrt((c.residual_lengths[rows] ** 2).mean()))


def test_the_residuals_over_a_picture_are_its_own(text, axial):
    lines = re.findall(r'd="([^"]*)" class="residual sure"', text)
    drawn = re.findall(r"M(\S+) (\S+?)l(\S+) (\S+?)(?=M|$)", lines[1])
    first = axial.calibration.views.groups[1]
    own = axial.residuals[first][~axial.calibration.outliers[first]]
    np.testing.assert_allclose(np.array(drawn, float)[:, 2:] / exaggeration(axial), own, atol=0.01)


def test_residuals_are_split_at_the_ray_that_passes_the_corner(axial):
    along, across = axial.along_and_across
    np.testing.assert_allclose(np.hypot(along, across), axial.calibration.residual_lengths, rtol=1e-9)
    points = axial.calibration.state.points(axial.calibration.views)[0]
    model = axial.camera.model
    start = model.pupil_z(axial.theta)
    # From where that ray starts, the corner lies at its angle, but for the residual.
    angle = np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2] - start)
    np.testing.assert_allclose(axial.theta, angle, atol=1e-6)


def test_it_draws_how_far_the_viewpoint_moves(text, axial):
    drawn, travel = part(text, "travel"), axial.travel
    assert "How to read this" in drawn
    assert f"by {axial.length(travel.length, travel.length_sigma)}" in drawn
    assert re.search(r"by [\d.]+ ± [\d.]+ mm", drawn)
    true = RayCamera(Axial(axial.camera.model.lens, (0.012,)), axial.camera.size)
    cone = axial.camera.theta_min, axial.reach
    assert abs(travel.length - true.model.pupil_shift(*cone)) < 5 * travel.length_sigma
    boards = np.linalg.norm(axial.calibration.state.points(axial.calibration.views)[0], axis=1)
    near, far = (float(value) for value in re.search(r"Corners were (\S+) mm to (\S+) mm away", drawn).groups())
    assert 1e3 * boards.min() * 0.99 <= near < far <= 1e3 * boards.max() * 1.01


def test_it_compares_with_the_best_central_camera_on_pictures_held_out(text, axial):
    drawn, c = part(text, "models"), axial.calibration
    assert f"central {c.central.name}" in drawn
    assert f"{c.central.held_out_rms:.4f}" in drawn
    assert f"{c.held_out_rms:.4f}" in drawn
    assert c.reason in drawn
    viewpoint = part(text, "viewpoint")
    assert f"{c.held_out_rms:.3f} px off if the viewpoint moves" in viewpoint
    assert "--model axial" not in viewpoint
    assert "omnisight convert --distance" in viewpoint


def test_where_a_central_camera_is_enough_it_says_so(axial):
    asked = replace(axial.asked, needed=False, doubt="")
    text = page(replace(axial, asked=asked))
    assert f"Take the central camera, --model {axial.calibration.central.state.model.name}" in part(text, "viewpoint")


def test_its_uncertainty_is_that_of_its_own_covariance(text, axial):
    pixels, _, theta, _ = axial.calibration.trust.uncertainty.worst()
    assert f"At worst it is {pixels:.2g} px" in part(text, "uncertainty")
    assert theta <= axial.reach + 1e-9
    np.testing.assert_array_equal(far_camera(axial.camera).covariance, axial.camera.covariance)


def test_only_formats_that_hold_rays_hold_it(text, axial, tmp_path):
    drawn = part(text, "downloads")
    ((held, name),) = re.findall(r'href="data:[^,"]*,([^"]*)" download="[^"]*" data-format="(\w+)"', drawn)
    assert name == "native"
    file = tmp_path / "camera.json"
    file.write_bytes(base64.b64decode(held))
    np.testing.assert_array_equal(load(file).model.params, axial.camera.model.params)
    np.testing.assert_array_equal(load(file).covariance, axial.camera.covariance)
    assert "omnisight convert camera.json --to opencv --distance 2m" in drawn


def test_it_advises_no_command_that_does_not_take_it(text):
    assert "omnisight next" not in text
    assert "--model spline" not in text


def test_lengths_are_in_squares_where_no_square_was_given(axial):
    board = axial.search.board
    search = replace(axial.search, board=Checkerboard(board.columns, board.rows))
    text = page(replace(axial, search=search, camera=replace(axial.camera, unit="squares"), asked=None))
    assert re.search(r"by [\d.]+ ± [\d.]+ squares", part(text, "travel"))
    assert " mm" not in text[text.index("<main>") : text.index('<script type="application/json"')]


def test_a_mirror_that_was_drawn_has_a_report_of_its_own(tmp_path):
    """Its rays pass no axis by its model: nothing is said of a travel, and all else is of it."""
    truth = off_focus()
    scale = 640 / SIZE[1]
    small = replace(truth, system=truth.system.rescaled(scale))
    search = seen(tmp_path, project=small.project)
    found = calibrate_rays(calibrated(search, model="double_sphere"), small.system, unit="m")
    m = Material(found, search, found.camera, [*NAMES, "torn.png", "empty.png"], COMMAND, asked=found.trust.viewpoint)
    text = page(m)
    figures = " ".join(re.findall(r'<section id="(\w+)"', text))
    assert figures == "verdict images coverage profile uncertainty residuals models boards parameters downloads"
    assert data_of(text)["camera"]["params"] == found.camera.model.to_dict()
    assert "mirror_tz" in part(text, "parameters")
    # Seen around the mirror, the middle of the image is the middle of the field.
    radius = np.linalg.norm(found.views.pixels - small.system.lens.project([0.0, 0.0, 1.0])[0], axis=1)
    assert np.corrcoef(radius[m.usable], m.theta[m.usable])[0, 1] > 0.95
    assert not re.search(r"\bnan\b", re.sub(r"base64,[^\"]*", "", text), re.IGNORECASE)


@pytest.mark.parametrize("count", [1, 2])
def test_few_pictures_give_a_report_too(count, tmp_path):
    moving = Axial(fisheye_setup(640).camera.model, PUPIL)
    search = seen(tmp_path, count=count, unread=False, project=moving.project)
    found = calibrate_rays(calibrated(search, model="equidistant", force=True), unit="m")
    text = page(Material(found, search, found.camera, NAMES[:count], ["omnisight"], asked=found.trust.viewpoint))
    assert data_of(text)["verdict"] == str(found.verdict) == "do not use"
    assert "A spline, which bends to any lens" not in part(text, "models")
    assert not re.search(r"\bnan\b", re.sub(r"base64,[^\"]*", "", text), re.IGNORECASE)
