"""The report of the calibration of a rig."""

import base64
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.rig_scenes import SCENES, scene

import omnisight as om
from notebook_html import assert_html
from omnisight.formats import load_rig, rig_format_names
from omnisight.models import model_class
from omnisight.optics.models.axial import Axial
from omnisight.report.report_data import ReportOptions
from omnisight.report.rigs.direction_map import share_of_sphere, visible_directions
from omnisight.report.rigs.page import render_rig_page, write_rig_report
from omnisight.report.rigs.rig_report_data import RigReportData
from omnisight.report.rigs.scene import edge_bearings
from omnisight.simulation.example_rigs import back_to_back
from reporting import contains_nan, embedded_json, section

COMMAND = ["omnisight", "calibrate-rig", "left images/*.png", "right", "--square", "30mm"]
SECTIONS = ("rig", "cameras", "pairs", "fields-of-view", "pose-uncertainty", "residuals", "downloads")


@pytest.fixture(scope="module")
def calibration():
    """Return the calibration of a stereo pair; 30 px are added to one view of the right camera."""
    make, square, frames = SCENES["stereo"]
    truth = scene(make, square, frames)
    observed = truth.observe(np.random.default_rng(1))
    pixels = observed["right"].pixels.copy()
    pixels[observed["right"].groups[2]] += (30.0, 0.0)
    observed["right"] = replace(observed["right"], pixels=np.clip(pixels, 0, np.array(observed["right"].size) - 1.0))
    return om.calibrate_rig(observed, om.CalibrateRigOptions(model="kannala_brandt"))


@pytest.fixture(scope="module")
def report(calibration, tmp_path_factory):
    path = tmp_path_factory.mktemp("rig") / "rig.html"
    write_rig_report(calibration, path, ReportOptions(COMMAND))
    return path


@pytest.fixture(scope="module")
def text(report):
    return report.read_text(encoding="utf-8")


def render(calibration):
    return render_rig_page(RigReportData(calibration))


def test_the_page_has_the_verdict_and_every_section(calibration, text):
    verdict = section(text, "verdict")
    assert f"<h2>{str(calibration.verdict).capitalize()}</h2>" in verdict
    assert len(calibration.verdict.checks) > 5
    for check in calibration.verdict.checks:
        assert check.name in verdict
        assert check.sentence in verdict
    for name in SECTIONS:
        assert section(text, name)
    assert not contains_nan(text)
    assert "'left images/*.png'" in text or '"left images/*.png"' in text


def test_the_page_loads_nothing(text):
    links = re.findall(r'(?:href|src)="([^"]*)"', text)
    assert links
    assert all(link.startswith(("#", "data:")) for link in links)
    assert "default-src &#x27;none&#x27;" in text


@pytest.mark.parametrize("name", SECTIONS[:-1])
def test_a_section_names_every_camera(text, calibration, name):
    for camera in calibration.rig.names:
        assert camera in section(text, name)


def test_the_embedded_json_has_the_rig_and_every_view(text, calibration):
    data = embedded_json(text)
    assert data["verdict"] == str(calibration.verdict)
    assert data["command"] == COMMAND
    assert list(data["rig"]["sensors"]) == ["left", "right"]
    assert len(data["images"]) == sum(calibration.images_of(name) for name in calibration.rig.names)
    assert [pair["shared_images"] for pair in data["pairs"]] == [pair.shared for pair in calibration.pairs]


def test_a_view_that_contradicts_the_extrinsics_stands_out(text, calibration):
    wrong = [view for view in embedded_json(text)["images"] if not view["agrees"]]
    assert [view["camera"] for view in wrong] == ["right"]
    residuals = section(text, "residuals")
    assert residuals.count("bar contradicting") == 1
    assert f"Contradict the extrinsics: <bdi>{wrong[0]['name']}" in residuals
    assert section(text, "rig").count("board dropped") == 1


def test_outliers_of_the_corners_do_not_count_in_the_residuals_of_views(text, calibration):
    # Corners have 0.3 px of noise in each coordinate, and 5 % of them are up to 30 px off.
    views = embedded_json(text)["images"]
    corners, outliers = (sum(view[key] for view in views) for key in ("corners", "outliers"))
    assert 0.03 < outliers / corners < 0.07
    assert max(view["rms"] for view in views) < 0.3 * np.sqrt(2) * 1.5 < calibration.rms


def test_downloads_hold_the_same_rig(text, calibration, tmp_path):
    found = re.findall(
        r'href="data:application/octet-stream;base64,([^"]*)" download="([^"]*)" data-format="(\w+)"', text
    )
    names = [name for *_, name in found]
    assert names[0] == "native"
    assert {"native", "kalibr", "opencv"} <= set(names) <= set(rig_format_names())
    for content, file, name in found:
        (tmp_path / file).write_bytes(base64.b64decode(content))
        rig = load_rig(tmp_path / file)
        ours, theirs = (r.with_reference(0).sensor_from_rig[1] for r in (calibration.rig, rig))
        # The rotation in the affine map of ocam cameras moves to the poses; there are none here.
        np.testing.assert_allclose(theirs.translation, ours.translation, atol=1e-6, err_msg=name)


def test_positions_have_the_uncertainty_of_simulated_steps(calibration):
    data, rig = RigReportData(calibration), calibration.rig
    k = rig.index("right")
    steps = np.random.default_rng(0).multivariate_normal(
        np.zeros(6), rig.covariance[6 * k : 6 * k + 6, 6 * k : 6 * k + 6], 20000
    )
    centres = np.array([rig.sensor_from_rig[k].moved(step).inverse().translation for step in steps[:4000]])
    expected = np.cov(centres.T)
    np.testing.assert_allclose(data.centre_covariance("right"), expected, atol=0.1 * np.abs(expected).max())


def test_the_scale_of_a_board_of_unknown_size_is_in_squares(calibration):
    page = render(replace(calibration, rig=replace(calibration.rig, unit="squares")))
    assert "position squares" in section(page, "cameras")
    assert " mm" not in section(page, "pose-uncertainty") + section(page, "cameras")
    assert embedded_json(page)["rig"]["length_unit"] == "squares"


def test_a_non_central_camera_is_in_the_report(calibration):
    camera = calibration.rig.cameras[0]
    rays = om.RayCamera(Axial(camera.model, (0.001,)), camera.size, theta_max=camera.theta_max)
    page = render(replace(calibration, rig=calibration.rig.replaced("left", rays)))
    assert not contains_nan(page)
    assert "axial" in section(page, "cameras")
    assert section(page, "downloads").count("data-format") == 1
    assert "non-central" in section(page, "downloads")


def test_cameras_with_boards_of_their_own_are_connected_by_motion(calibration, text):
    estimate = calibration.estimate
    left, right = estimate.observations.parts
    state = replace(
        estimate.state,
        group_from_board=estimate.state.group_from_board[np.zeros(2, int)],
        warps=np.repeat(estimate.state.warps, 2, axis=0),
    )
    observations = replace(estimate.observations, parts=(left, replace(right, board=1)))
    page = render(replace(calibration, estimate=replace(estimate, observations=observations, state=state)))
    assert "link by motion" in section(page, "pairs")
    assert "by motion" not in section(text, "pairs")
    # One board per camera and moment, instead of one per moment.
    assert section(page, "rig").count('class="board') > section(text, "rig").count('class="board')


def test_names_are_escaped(calibration):
    rig = replace(calibration.rig, provenance={"tool": "<script>alert(1)</script>"})
    page = render(replace(calibration, rig=rig))
    assert "<script>alert" not in page
    assert json.loads(json.dumps(embedded_json(page)["rig"]["provenance"])) == {"tool": "<script>alert(1)</script>"}


def test_two_hemispheres_cover_the_sphere():
    seen = visible_directions(back_to_back())
    assert share_of_sphere(seen.any(0)) == 1
    assert 0 < share_of_sphere(seen.all(0)) < 0.2
    cap = np.linspace(90, -90, 361)[:-1] - 0.25 > 30  # latitudes above 30 degrees: a quarter of the sphere
    assert share_of_sphere(np.repeat(cap[:, None], 4, 1)) == pytest.approx(0.25, abs=0.002)


def test_the_edge_of_a_field_of_view_is_at_its_angle():
    camera = om.Camera(model_class("kannala_brandt").example(), (4000, 4000), theta_max=np.radians(70))
    centred = om.Camera(replace(camera.model, cx=2000.0, cy=2000.0), camera.size, theta_max=camera.theta_max)
    angles = np.degrees(np.arccos(edge_bearings(centred, 1.0)[:, 2]))
    assert abs(angles - 70).max() <= 0.5


def test_the_page_runs_in_a_browser(report, opened):
    page = opened(report)
    board = page.locator(".scene .board").first
    before = board.get_attribute("d")
    page.locator(".scene").focus()
    page.keyboard.press("ArrowLeft")
    assert board.get_attribute("d") != before


def test_the_calibration_is_shown_in_notebooks(calibration):
    page = assert_html(calibration, f'rms</th><td style="text-align:left">{calibration.rms:.3f} px')
    for name in calibration.rig.names:
        assert f"rms {calibration.camera_rms(name):.3f} px" in page


def test_the_rig_of_a_calibration_is_plotted(calibration):
    pytest.importorskip("matplotlib")
    axes = om.plot_cameras(calibration).axes[0]
    assert [text.get_text() for text in axes.texts] == list(calibration.rig.names)
    assert axes.get_xlabel() == f"x, {calibration.rig.unit}"
