"""The report as a file: what it holds, how large it is, and what it does with odd calibrations."""

import base64
import hashlib
import os
import re
from dataclasses import replace

import numpy as np
import pytest
from reporting import NAMES, calibrated, data_of, seen, written

from omnisight.camera import Camera
from omnisight.models import model_class
from omnisight.report.axes import round_down, ticks
from omnisight.report.html import Markup, element
from omnisight.report.report_data import Material, outwards_at
from omnisight.report.number_format import with_sigma
from omnisight.report.sections.images import MOST, embedded_width
from omnisight.report.sections.residuals import Against
from omnisight.targets import Checkerboard, detect_boards


def test_a_machine_reads_the_calibration_from_it(report, material):
    data = data_of(report.read_text("utf-8"))
    calibration = material.calibration
    assert data["camera"]["params"] == material.camera.model.to_dict()
    assert data["verdict"] == str(calibration.verdict)
    assert [picture["name"] for picture in data["images"]] == [*NAMES, "torn.png", "empty.png"]
    squares = [p["corners"] * p["rms"] ** 2 for p in data["images"] if p["rms"] is not None]
    assert np.sqrt(sum(squares) / len(calibration.views.pixels)) == pytest.approx(calibration.rms)
    assert data["images"][0]["worst"] == pytest.approx(np.sqrt(2) * 3, abs=0.5)
    for k, picture in enumerate(data["images"][:10]):
        (pose,) = picture["cam_from_board"]
        np.testing.assert_array_equal(pose["rotation"], calibration.state.rotations[k])
        np.testing.assert_array_equal(pose["translation"], calibration.state.translations[k])
    assert data["images"][10] | {"name": ""} == {
        "name": "",
        "corners": 0,
        "doubtful": 0,
        "rms": None,
        "worst": None,
        "note": "torn.png: empty file",
        "cam_from_board": [],
    }


def test_it_runs_only_its_own_script_and_style(report):
    text = report.read_text("utf-8")
    policy = re.search(r'http-equiv="Content-Security-Policy" content="(.*?)"', text)[1].replace("&#x27;", "'")
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    for tag in ("style", "script"):
        inside = re.search(f"<{tag}>(.*?)</{tag}>", text, re.DOTALL)[1]
        digest = base64.b64encode(hashlib.sha256(inside.encode()).digest()).decode()
        assert f"{tag}-src 'sha256-{digest}'" in policy
    assert re.findall(r"""(?:href|src)=["'](?!#|data:)""", text) == []
    assert "http:" not in text
    assert "https:" not in text


@pytest.mark.parametrize(
    ("size", "count"), [((640, 480), 17), ((4000, 3000), 60), ((1920, 1080), 300), ((320, 240), 5)]
)
def test_pictures_are_embedded_within_bounds(size, count):
    width = embedded_width(size, count)
    shown = min(count, MOST)
    assert width <= min(700, size[0])
    assert shown * embedded_width(size, shown) ** 2 * size[1] / size[0] <= 9.2e6
    assert width >= min(240, size[0])


def test_a_report_of_noise_is_no_larger_than_is_said(material, tmp_path):
    # Nothing compresses worse than noise.
    noise = np.random.default_rng(0).integers(0, 255, (480, 640, 3), np.uint8)
    from omnisight.images import write_image

    pictures = [replace(p, path=tmp_path / "noise.png") for p in material.search.images]
    write_image(tmp_path / "noise.png", noise)
    noisy = written(replace(material, search=replace(material.search, images=pictures)), tmp_path / "report.html")
    assert 1e6 < noisy.stat().st_size < 8e6


@pytest.mark.parametrize("count", [1, 2])
def test_few_pictures_give_a_report_too(count, tmp_path):
    search = seen(tmp_path, count=count, unread=False)
    calibration = calibrated(search, model="equidistant", force=True)
    m = Material(calibration, search, calibration.camera, NAMES[:count], ["omnisight"])
    text = written(m, tmp_path / "report.html").read_text("utf-8")
    assert data_of(text)["verdict"] == str(calibration.verdict) == "do not use"
    assert not re.search(r"\bnan\b", re.sub(r"base64,[^\"]*", "", text), re.IGNORECASE)


def test_a_camera_without_figures_gives_a_report_too(material, tmp_path):
    """Where nothing is known of the uncertainty, the page says so."""
    trust = material.calibration.trust
    nothing = np.full_like(trust.uncertainty.pixels, np.nan)
    unsure = replace(trust.uncertainty, pixels=nothing, angles=nothing)
    trust = replace(trust, uncertainty=unsure, halves=None, ceiling=None)
    chosen = replace(material.calibration.chosen, held_out_rms=None)
    calibration = replace(material.calibration, trust=trust, chosen=chosen)
    camera = replace(material.camera, covariance=np.full_like(material.camera.covariance, np.nan))
    m = replace(material, calibration=calibration, camera=camera)
    with pytest.raises(ValueError, match="JSON compliant"):
        written(m, tmp_path / "report.html")  # the camera's own file could not be written either
    m = replace(m, camera=replace(camera, covariance=np.zeros_like(camera.covariance)))
    text = written(m, tmp_path / "report.html").read_text("utf-8")
    assert "so few images do not tell it" in text
    assert "unknown" in text


def test_a_picture_that_is_gone_costs_only_itself(material, tmp_path):
    pictures = list(material.search.images)
    pictures[3] = replace(pictures[3], path=tmp_path / "gone.png")
    m = replace(material, search=replace(material.search, images=pictures))
    text = written(m, tmp_path / "report.html").read_text("utf-8")
    assert text.count("<image ") == 10


def test_a_picture_is_dropped_by_its_name_as_a_shell_takes_it(material):
    words = [material.dropping(replace(material.images[0], name=name)) for name in ("3.png", "a b.png", "-x.png")]
    quote = '"' if os.name == "nt" else "'"
    assert words == ["--drop 3.png", f"--drop {quote}a b.png{quote}", "--drop=-x.png"]


def test_outwards_is_away_from_the_centre():
    camera = Camera(model_class("equidistant")(200.0, 200.0, 320.0, 240.0), (640, 480))
    theta, phi = np.array([0.3, 1.2, 2.0]), np.array([0.0, 1.0, -2.5])
    np.testing.assert_allclose(outwards_at(camera, theta, phi), np.stack([np.cos(phi), np.sin(phi)], 1), atol=1e-9)


def test_residuals_are_split_along_and_across_the_radius(material):
    along, across = material.along_and_across
    lengths = material.calibration.residual_lengths
    np.testing.assert_allclose(np.hypot(along, across), lengths, rtol=1e-9)


def test_means_show_the_wave_that_is_there():
    noise = np.random.default_rng(0)
    x = noise.uniform(0, 80, 6000)
    wave = 0.1 * np.sin(np.radians(4.5 * x))
    against = Against("angle", x, np.linspace(0, 80, 15))
    middle, mean, error = against.means(wave + noise.normal(0, 0.1, len(x)), np.ones(len(x), bool))
    np.testing.assert_allclose(mean, 0.1 * np.sin(np.radians(4.5 * middle)), atol=0.03)
    np.testing.assert_allclose(error, 0.1 / np.sqrt(6000 / 14), rtol=0.2)


def test_nothing_but_markup_is_markup():
    assert element("p", "<b> & 'x'", title='a"b<') == "<p title=\"a&quot;b&lt;\">&lt;b&gt; &amp; 'x'</p>"
    assert element("p", Markup("<br>"), None, hidden=True, id=None, class_="a") == '<p hidden class="a"><br></p>'
    with pytest.raises(ValueError, match="finite"):
        element("rect", x=float("nan"))


def test_scales_have_round_numbers():
    assert ticks(0, 122) == [0, 20, 40, 60, 80, 100, 120]
    assert ticks(-0.45, 0.45, about=5) == pytest.approx([-0.4, -0.2, 0, 0.2, 0.4])
    assert [round_down(v) for v in (1, 1.99, 4.9, 87, 0.031)] == pytest.approx([1, 1, 2, 50, 0.02])


@pytest.mark.parametrize(
    ("value", "sigma", "said"),
    [
        (384.2134, 0.0412, ("384.213", "0.041")),
        (-1.5e-3, 7.2e-4, ("−0.00150", "0.00072")),
        (-4.371e-9, 2.2e-11, ("−4.371e-9", "0.022e-9")),
        (12345.6, 345.0, ("1.235e4", "0.035e4")),
        (0.0, 0.0, ("0", "–")),
    ],
)
def test_a_value_has_as_many_digits_as_it_is_known_to(value, sigma, said):
    assert with_sigma(value, sigma) == said


@pytest.mark.slow
def test_real_pictures_come_with_their_residuals(data, tmp_path):
    paths = sorted(data("fisheye1_urban").glob("*.jpg"))[:4]
    search = detect_boards(paths, Checkerboard(8, 6, 0.0325))
    calibration = calibrated(search, model="kannala_brandt")
    m = Material(calibration, search, calibration.camera, [path.name for path in paths], ["omnisight"])
    text = written(m, tmp_path / "report.html").read_text("utf-8")
    assert text.count("<image ") == 4
    assert text.count('class="residual sure"') == 4
    assert len(text) < 2e6
