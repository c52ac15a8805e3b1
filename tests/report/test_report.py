"""The report of a central camera: content, size, and unusual calibrations."""

import base64
import hashlib
import os
import re
from dataclasses import replace

import numpy as np
import pytest

from omnisight.camera import Camera
from omnisight.images import write_image
from omnisight.models import model_class
from omnisight.pipeline.calibration.calibrate import with_ocamcalib
from omnisight.progress import no_progress
from omnisight.quality.evidence import Check, Level
from omnisight.quality.verdict import Verdict
from omnisight.report.axes import nice_floor, nice_ticks
from omnisight.report.html import Markup, element
from omnisight.report.number_format import format_with_sigma
from omnisight.report.page import render_page
from omnisight.report.report_data import radial_directions
from omnisight.report.sections.images import MAX_IMAGES, embedded_width
from omnisight.report.sections.residuals import Abscissa
from omnisight.targets import Checkerboard, detect_boards
from reporting import (
    NAMES,
    UNUSED_NAMES,
    calibrate_detections,
    contains_nan,
    embedded_json,
    report_data,
    simulate_detections,
    with_images,
    with_observations,
    with_quality,
    write,
)


def test_the_camera_of_the_report_has_its_own_figures_beside_ocamcalib(central):
    data = report_data(with_ocamcalib(central.calibration, no_progress))
    assert data.calibration.camera.calibration["method"] == "ocamcalib"
    assert data.camera.model == central.calibration.state.model
    assert data.camera.calibration == central.calibration.figures()


def test_the_blind_spot_of_a_mirror_is_hatched(central):
    camera = replace(central.camera, theta_min=np.radians(20))
    text = render_page(replace(central, calibration=replace(central.calibration, camera=camera)))
    edge = re.findall(r'd="([^"]*)" class="calibrated-edge"></path></g>', text)[0].split("Z")
    boundaries = [np.array(re.findall(r"[-.\d]+", part), float).reshape(-1, 2) for part in edge[:-1]]
    for boundary, theta in zip(boundaries, (camera.theta_max, camera.theta_min), strict=True):
        np.testing.assert_allclose(camera.angle_of(boundary), theta, atol=0.01)


def test_embedded_json_contains_the_calibration(report, central):
    data = embedded_json(report.read_text("utf-8"))
    calibration = central.calibration
    assert data["camera"]["params"] == central.camera.model.to_dict()
    assert data["verdict"] == str(calibration.verdict)
    assert [image["name"] for image in data["images"]] == [*NAMES, *UNUSED_NAMES]
    squares = [image["corners"] * image["rms"] ** 2 for image in data["images"] if image["rms"] is not None]
    assert np.sqrt(sum(squares) / len(central.observations.pixels)) == pytest.approx(calibration.rms)
    assert data["images"][0]["worst"] == pytest.approx(np.sqrt(2) * 3, abs=0.5)
    for k, image in enumerate(data["images"][:10]):
        (pose,) = image["cam_from_board"]
        np.testing.assert_array_equal(pose["rotation"], calibration.state.rotations[k])
        np.testing.assert_array_equal(pose["translation"], calibration.state.translations[k])
    assert data["images"][10] | {"name": ""} == {
        "name": "",
        "corners": 0,
        "outliers": 0,
        "rms": None,
        "worst": None,
        "note": "torn.png: empty file",
        "cam_from_board": [],
    }


def test_security_policy_allows_only_the_embedded_script_and_style(report):
    text = report.read_text("utf-8")
    policy = re.search(r'http-equiv="Content-Security-Policy" content="(.*?)"', text)[1].replace("&#x27;", "'")
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    for tag in ("style", "script"):
        content = re.search(f"<{tag}>(.*?)</{tag}>", text, re.DOTALL)[1]
        digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
        assert f"{tag}-src 'sha256-{digest}'" in policy
    assert re.findall(r"""(?:href|src)=["'](?!#|data:)""", text) == []
    assert "http:" not in text
    assert "https:" not in text


@pytest.mark.parametrize(
    ("size", "count"), [((640, 480), 17), ((4000, 3000), 60), ((1920, 1080), 300), ((320, 240), 5)]
)
def test_size_of_embedded_images_is_bounded(size, count):
    width = embedded_width(size, count)
    shown = min(count, MAX_IMAGES)
    assert width <= min(700, size[0])
    assert shown * embedded_width(size, shown) ** 2 * size[1] / size[0] <= 9.2e6
    assert width >= min(240, size[0])


def test_report_with_images_of_noise_is_below_the_documented_size(central, tmp_path):
    # Noise is the least compressible content.
    noise = np.random.default_rng(0).integers(0, 255, (480, 640, 3), np.uint8)
    write_image(tmp_path / "noise.png", noise)
    images = [replace(image, path=tmp_path / "noise.png") for image in central.detections.images]
    path = write(with_images(central, images), tmp_path / "report.html")
    assert 1e6 < path.stat().st_size < 8e6


@pytest.mark.parametrize("count", [1, 2])
def test_report_of_one_or_two_images(count, tmp_path):
    detections = simulate_detections(tmp_path, count=count, unused=False)
    calibration = calibrate_detections(detections, NAMES[:count], model="equidistant", force=True)
    text = render_page(report_data(calibration))
    assert embedded_json(text)["verdict"] == str(calibration.verdict) == "do not use"
    assert not contains_nan(text)


def test_report_of_a_calibration_from_arrays(central):
    data = with_observations(central, detections=None)
    text = render_page(data)
    assert [image["name"] for image in embedded_json(text)["images"]] == NAMES
    assert "<image " not in text
    assert text.count('class="residual inlier"') == len(NAMES)


def test_a_passed_check_with_a_remark_has_no_tick(central):
    checks = (
        Check("image count"),
        Check("board bend", Level.GOOD, "It bends."),
        Check("outliers", Level.USABLE, "Drop."),
    )
    text = render_page(with_quality(central, verdict=Verdict(Level.USABLE, checks)))
    chips = re.search(r'<ul class="checks".*?</ul>', text, re.DOTALL)[0]
    assert re.findall(r'<li class="([\w-]+)">(.*?)</li>', chips) == [
        ("good", "✓ image count"),
        ("remark", "i board bend"),
        ("usable", "! outliers"),
    ]
    reasons = re.search(r'<ul class="reasons".*?</ul>', text, re.DOTALL)[0]
    assert re.findall(r"<b class=\"([\w-]+)\">(.)</b> (.*?)</li>", reasons) == [
        ("usable", "!", "Drop."),
        ("remark", "i", "It bends."),
    ]


def test_the_uncertainty_is_the_rms_that_the_terminal_prints(central):
    px, degrees = central.uncertainty.rms(), np.degrees(central.uncertainty.rms_angle())
    tile = re.search(r"<dt>Projection uncertainty</dt>.*?</div>", render_page(central), re.DOTALL)[0]
    assert f"± {px:.2g} px" in tile
    assert f"{degrees:.2g}° (rms, 1σ)" in tile
    assert 0 < px < central.uncertainty.worst()[0]


def test_report_without_quality_figures(central):
    """Unknown uncertainties are reported as unknown."""
    unknown = np.full_like(central.uncertainty.pixels, np.nan)
    uncertainty = replace(central.uncertainty, pixels=unknown, angles=unknown)
    data = with_quality(central, uncertainty=uncertainty, split_half=None, spline_baseline=None)
    selection = data.calibration.selection
    selection = replace(selection, best=replace(selection.best, held_out_rms=None))
    calibration = replace(data.calibration, selection=selection)

    def data_with_covariance(covariance):
        camera = replace(calibration.camera, covariance=covariance)
        return replace(data, calibration=replace(calibration, camera=camera))

    zero = np.zeros_like(central.camera.covariance)
    for covariance in (zero, np.full_like(zero, np.nan), None):
        text = render_page(data_with_covariance(covariance))
        assert "unknown: not enough images" in text
        assert ">unknown<" in text
        assert not contains_nan(text)


def test_a_deleted_image_is_omitted(central, tmp_path):
    images = list(central.detections.images)
    images[3] = replace(images[3], path=tmp_path / "deleted.png")
    assert render_page(with_images(central, images)).count("<image ") == 10


def test_drop_options_are_quoted_for_the_shell(central):
    options = [central.drop_option(replace(central.images[0], name=name)) for name in ("3.png", "a b.png", "-x.png")]
    quote = '"' if os.name == "nt" else "'"
    assert options == ["--drop 3.png", f"--drop {quote}a b.png{quote}", "--drop=-x.png"]


def test_radial_directions_point_away_from_the_principal_point():
    camera = Camera(model_class("equidistant")(200.0, 200.0, 320.0, 240.0), (640, 480))
    theta, phi = np.array([0.3, 1.2, 2.0]), np.array([0.0, 1.0, -2.5])
    expected = np.stack([np.cos(phi), np.sin(phi)], 1)
    np.testing.assert_allclose(radial_directions(camera, theta, phi), expected, atol=1e-9)


def test_radial_and_tangential_residuals_preserve_lengths(central):
    radial, tangential = central.radial_and_tangential
    lengths = central.calibration.residual_lengths
    np.testing.assert_allclose(np.hypot(radial, tangential), lengths, rtol=1e-9)


def test_bin_means_recover_a_wave():
    rng = np.random.default_rng(0)
    x = rng.uniform(0, 80, 6000)
    wave = 0.1 * np.sin(np.radians(4.5 * x))
    abscissa = Abscissa("angle", x, np.linspace(0, 80, 15))
    centre, mean, error = abscissa.bin_means(wave + rng.normal(0, 0.1, len(x)), np.ones(len(x), bool))
    assert len(centre) == 14
    np.testing.assert_allclose(mean, 0.1 * np.sin(np.radians(4.5 * centre)), atol=0.03)
    np.testing.assert_allclose(error, 0.1 / np.sqrt(6000 / 14), rtol=0.2)


def test_elements_escape_text_but_not_markup():
    assert element("p", "<b> & 'x'", title='a"b<') == "<p title=\"a&quot;b&lt;\">&lt;b&gt; &amp; 'x'</p>"
    assert element("p", Markup("<br>"), None, hidden=True, id=None, class_="a") == '<p hidden class="a"><br></p>'
    with pytest.raises(ValueError, match="finite"):
        element("rect", x=float("nan"))


def test_ticks_and_scales_are_round_numbers():
    assert nice_ticks(0, 122) == [0, 20, 40, 60, 80, 100, 120]
    assert nice_ticks(-0.45, 0.45, count=5) == pytest.approx([-0.4, -0.2, 0, 0.2, 0.4])
    assert [nice_floor(v) for v in (1, 1.99, 4.9, 87, 0.031)] == pytest.approx([1, 1, 2, 50, 0.02])


@pytest.mark.parametrize(
    ("value", "sigma", "text"),
    [
        (384.2134, 0.0412, ("384.213", "0.041")),
        (-1.5e-3, 7.2e-4, ("−0.00150", "0.00072")),
        (-4.371e-9, 2.2e-11, ("−4.371e-9", "0.022e-9")),
        (12345.6, 345.0, ("1.235e4", "0.035e4")),
        (0.0, 0.0, ("0", "–")),
    ],
)
def test_values_have_the_digits_that_their_sigma_justifies(value, sigma, text):
    assert format_with_sigma(value, sigma) == text


@pytest.mark.slow
def test_report_of_real_images(data):
    paths = sorted(data("fisheye1_urban").glob("*.jpg"))[:4]
    detections = detect_boards(paths, Checkerboard(8, 6, 0.0325))
    text = render_page(report_data(calibrate_detections(detections, model="kannala_brandt")))
    assert text.count("<image ") == 4
    assert text.count('class="residual inlier"') == 4
    assert len(text) < 2e6
