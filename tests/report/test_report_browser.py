"""The report in a browser."""

import base64
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from omnisight.formats import format_names, get_format, load
from omnisight.report.report_data import ReportOptions
from reporting import COMMAND, NAMES, UNUSED_NAMES, with_observations, write

# The sections in the order of the page; an axial camera has one more between them.
FIRST = "images coverage profile"
LAST = "uncertainty residuals models noncentral-test board-poses parameters downloads"
# Number of shapes of a drawing that have an extent.
SHAPES = """svg => [...svg.querySelectorAll('path, rect')].filter(
    shape => shape.getBBox().width + shape.getBBox().height > 0).length"""


def test_verdict_is_visible_first(opened, report, central):
    page = opened(report)
    assert page.title().startswith(f"Calibration: {central.calibration.verdict}")
    first = page.locator("main > section").first
    assert first.get_attribute("id") == "verdict"
    box = first.bounding_box()
    assert box["y"] >= 0
    assert box["y"] + box["height"] < 800
    assert first.locator("h2").inner_text().lower() == str(central.calibration.verdict)
    for sentence in central.calibration.verdict.reasons:
        assert sentence in first.inner_text()


def test_all_sections_are_drawn_with_a_guide(opened, report):
    page = opened(report)
    figures = page.locator("section.figure")
    names = [figure.get_attribute("id") for figure in figures.all()]
    assert " ".join(names) == f"{FIRST} {LAST}"
    assert_drawn(page)


def test_axial_camera_has_a_section_about_the_entrance_pupil_shift(opened, axial_report):
    page = opened(axial_report)
    names = [figure.get_attribute("id") for figure in page.locator("section.figure").all()]
    assert " ".join(names) == f"{FIRST} pupil-shift {LAST}"
    assert_drawn(page)
    assert page.locator("#pupil-shift svg.chart .line.curve").count() == 1
    assert page.locator("#pupil-shift svg.chart .band").count() == 1


def assert_drawn(page):
    figures = page.locator("section.figure")
    for figure in figures.all():
        name = figure.get_attribute("id")
        assert figure.locator(".body").bounding_box()["height"] > 100, name
        assert figure.locator(".guide h3").inner_text().lower() == "how to read this"
        paragraphs = figure.locator(".guide p").all_inner_texts()
        assert len(paragraphs) == 3
        assert min(map(len, paragraphs)) > 30, name
        for drawing in figure.locator("svg.chart, svg.scene, svg.arrows").all():
            assert drawing.evaluate(SHAPES) >= 3, name
            assert drawing.get_attribute("aria-label"), name
    drawn = {name: page.locator(f"#{name} .body svg.chart").count() for name in ("profile", "uncertainty", "residuals")}
    assert drawn == {"profile": 2, "uncertainty": 2, "residuals": 4}
    assert page.locator("nav a").count() == figures.count()
    assert "NaN" not in page.content()
    assert not re.search(r"\bnan\b", page.locator("body").inner_text())


def test_images_are_shown_with_residuals(opened, report):
    page = opened(report)
    cards = page.locator(".card")
    assert cards.count() == 12
    assert cards.locator("image").count() == 11  # one file is unreadable
    widths = page.evaluate(
        """Promise.all([...document.querySelectorAll('image')].map(async image => {
            const bitmap = new Image();
            bitmap.src = image.getAttribute('href');
            await bitmap.decode();
            return bitmap.naturalWidth;
        }))"""
    )
    assert set(widths) == {640}
    times = re.search(r"magnified (\d+) times", page.locator("#images .body > .note").inner_text())[1]
    for card in cards.all()[:10]:
        assert card.locator(".magnification").text_content() == f"residuals × {times}"
    # The residual of the corner that is 3 px off, magnified.
    line = cards.first.locator(".outlier").get_attribute("d")
    along = np.array(re.match(r"M\S+ \S+?l(\S+) (\S+)", line).groups(), float) / float(times)
    np.testing.assert_allclose(along, [-3, -3], atol=0.4)
    assert "empty file" in cards.nth(10).inner_text()
    assert "no 8x5 board found" in cards.nth(11).inner_text()


def test_pointing_at_a_residual_shows_its_value(opened, report):
    page = opened(report)
    drawing = page.locator(".card .image").first
    drawing.scroll_into_view_if_needed()
    line = drawing.locator(".outlier").get_attribute("d")
    u, v = map(float, re.match(r"M(\S+) (\S+?)l", line).groups())
    box = drawing.bounding_box()
    value = page.locator("#residual-value")
    page.mouse.move(box["x"] + box["width"] * (u + 0.5) / 640, box["y"] + box["width"] * (v + 0.5) / 640)
    residual = re.match(rf"corner \({u:.1f}, {v:.1f}\): (\S+) px \((\S+), (\S+)\)", value.inner_text())
    np.testing.assert_allclose(np.array(residual.groups(), float), [3 * 2**0.5, -3, -3], atol=0.5)
    page.mouse.move(1, 1)
    assert not value.is_visible()


def test_images_are_shown_undistorted(opened, report):
    page = opened(report)
    card = page.locator(".card").nth(1)
    original, undistorted = card.locator(".image"), card.locator(".undistorted")
    assert (original.is_visible(), undistorted.is_visible()) == (True, False)
    assert page.locator("#residual-note").is_visible()
    page.click("#undistort")
    assert (original.is_visible(), undistorted.is_visible()) == (False, True)
    assert not page.locator("#residual-note").is_visible()
    assert page.locator(".undistorted").count() == 11
    undistorted.scroll_into_view_if_needed()
    assert undistorted.evaluate("async image => { await image.decode(); return image.naturalWidth; }") == 448
    page.click("#undistort")
    assert original.is_visible()
    assert page.locator("#residual-note").is_visible()


def test_errors_of_the_models_are_visible_on_a_narrow_screen(opened, axial_report):
    page = opened(axial_report, width=500)
    for column, name in enumerate(["held-out rms, px", "rms, px"], 2):
        header = page.locator(f".models thead th:nth-child({column})")
        assert header.inner_text() == name
        box = header.bounding_box()
        assert box["x"] + box["width"] <= 500


def test_clicking_an_image_drops_it_and_shows_the_command(opened, report):
    page = opened(report, permissions=["clipboard-read", "clipboard-write"])
    bar, command = page.locator("#dropped"), page.locator("#dropped-command")
    assert not bar.is_visible()
    page.locator(".card .drop").nth(2).click()
    page.locator(".card .drop").nth(6).click()
    assert bar.is_visible()
    assert bar.bounding_box()["y"] >= -1
    assert "2 images dropped, 8 left" in bar.inner_text()
    wanted = "omnisight calibrate 'my images/*.png' -o camera.json --drop 'img 3.png' --drop 'img 7.png'"
    assert command.text_content().replace('"', "'") == wanted
    assert page.locator(".card").nth(2).locator(".drop").get_attribute("aria-pressed") == "true"
    assert page.locator(".bar.dropped").count() == 2
    assert page.locator(".scene .board.dropped").count() == 2
    page.locator("#dropped-copy").click()
    page.get_by_text("Copied", exact=True).wait_for()
    assert page.evaluate("navigator.clipboard.readText()").replace('"', "'") == wanted
    page.locator(".card .drop").nth(2).click()
    assert "1 image dropped, 9 left" in bar.inner_text()
    page.locator("#dropped-none").click()
    assert not bar.is_visible()
    assert page.locator(".dropped").count() == 0


def test_report_is_usable_with_the_keyboard(opened, report):
    page = opened(report)
    page.locator(".card .drop").first.focus()
    page.keyboard.press("Space")
    assert "img 1.png" in page.locator("#dropped-command").text_content()
    page.locator(".card .enlarge").first.focus()
    page.keyboard.press("Enter")
    assert page.locator("dialog .image").is_visible()
    page.keyboard.press("Escape")
    assert not page.locator("dialog .image").is_visible()
    scene = page.locator(".scene")
    axis = scene.locator(".axis-x")
    before = axis.get_attribute("d")
    scene.focus()
    for key in ("ArrowLeft", "ArrowUp", "+"):
        page.keyboard.press(key)
    assert axis.get_attribute("d") != before
    page.keyboard.press("Home")
    # The script draws the same as the static page.
    back, first = (np.array(re.findall(r"[-.\d]+", d), float) for d in (axis.get_attribute("d"), before))
    np.testing.assert_allclose(back, first, atol=0.1)


def test_board_poses_rotate_with_the_mouse(opened, report):
    page = opened(report)
    scene = page.locator(".scene")
    scene.scroll_into_view_if_needed()
    box = scene.bounding_box()
    boards = scene.locator(".board")
    assert boards.count() == 10
    still = sorted(board.get_attribute("d") for board in boards.all())
    page.mouse.move(box["x"] + 200, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] + 300, box["y"] + 230, steps=3)
    page.mouse.up()
    assert sorted(board.get_attribute("d") for board in boards.all()) != still


@pytest.mark.parametrize("name", ["native", "kalibr", "numpy_arrays"])
def test_clicking_a_format_downloads_the_camera(name, opened, report, central, tmp_path):
    page = opened(report)
    with page.expect_download() as download:
        page.locator(f"a[data-format='{name}']").click()
    file = tmp_path / download.value.suggested_filename
    assert file.name == f"camera-{name}{get_format(name).SUFFIX}"
    download.value.save_as(file)
    assert_same(load(file), central.camera)
    if name == "native":
        assert load(file).covariance.tolist() == central.camera.covariance.tolist()


def test_every_format_has_a_file_or_a_reason(opened, report, central, tmp_path):
    page = opened(report)
    page.locator("#downloads summary").click()
    refused = page.locator(".refused").inner_text()
    links = {link.get_attribute("data-format"): link for link in page.locator("a[data-format]").all()}
    fitted = 0
    for name in format_names():
        if name not in links:
            assert central.camera.model.name not in get_format(name).MODELS
            assert f"{get_format(name).TITLE}: " in refused
            continue
        start, _, held = links[name].get_attribute("href").partition(",")
        assert start == "data:application/octet-stream;base64"
        file = tmp_path / links[name].get_attribute("download")
        file.write_bytes(base64.b64decode(held))
        own = load(file).model.name == central.camera.model.name
        assert_same(load(file), central.camera, 1e-6 if own else 1.0)
        assert links[name].locator("xpath=..").locator("span").count() == (not own)
        fitted += not own
    assert fitted >= 1
    assert len(links) > 10


def assert_same(camera, truth, within=1e-6):
    bearings, pixels = truth.samples()
    np.testing.assert_allclose(camera.project(bearings)[0], pixels, atol=within)


def test_file_names_cannot_inject_markup(opened, central, tmp_path):
    names = ["</script><script>window.hit = 1</script>", '"><img src=x onerror="window.hit = 1">', "a'; rm -rf $X.png"]
    names += ["\udcff\u202egnp.exe", "-rf.png", *NAMES[5:]]
    hostile = with_observations(central, image_names=(*names, *UNUSED_NAMES))
    hostile = replace(hostile, options=ReportOptions([*COMMAND, "<b>&amp;"]))
    page = opened(write(hostile, tmp_path / "report.html"))
    assert page.evaluate("window.hit") is None
    assert page.locator("img:not(.undistorted)").count() == 0
    shown = page.locator(".card bdi").all_text_contents()
    assert shown[:3] == names[:3]
    assert "<b>&amp;" in page.locator("footer").inner_text()
    data = json.loads(page.locator("#calibration").text_content())
    assert [image["name"] for image in data["images"]][:5] == names[:5]
    page.locator(".card .drop").nth(4).click()
    assert page.locator("#dropped-command").text_content().endswith(" --drop=-rf.png")


def test_network_access_is_blocked(browser, report):
    # The fixture `opened` would fail, since blocked requests are logged to the console.
    page = browser.new_context().new_page()
    page.goto(report.as_uri())
    stopped = page.evaluate(
        """() => new Promise(done => {
            document.addEventListener('securitypolicyviolation', event => done(event.effectiveDirective));
            new Image().src = 'http://127.0.0.1:9/';
        })"""
    )
    assert stopped == "img-src"
    assert page.evaluate("() => fetch('http://127.0.0.1:9/').then(() => 'reached', () => 'stopped')") == "stopped"
    page.context.close()


@pytest.mark.parametrize("width", [320, 390, 768])
def test_report_fits_narrow_screens(width, opened, report):
    page = opened(report, width=width)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.locator("#coverage svg").bounding_box()["width"] > 0.8 * width or width > 400


def test_report_follows_the_color_scheme_and_prints(opened, report):
    def lightness(page):
        rgb = re.findall(r"\d+", page.evaluate("getComputedStyle(document.body).backgroundColor"))
        return sum(map(int, rgb[:3])) / 3

    assert lightness(opened(report, color_scheme="light")) > 230
    page = opened(report, color_scheme="dark")
    assert lightness(page) < 40
    page.emulate_media(media="print", color_scheme="light")
    assert not page.locator("nav").is_visible()
    assert page.locator("#residuals svg").first.is_visible()


def test_report_is_complete_without_scripts(opened, report):
    page = opened(report, java_script_enabled=False)
    assert page.locator("#verdict h2").is_visible()
    assert page.locator(".scene .board").count() == 10
    assert page.locator(".scene .board").first.get_attribute("d").startswith("M")
