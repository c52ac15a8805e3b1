"""A calibration with its report, and a browser that opens it."""

from dataclasses import replace

import pytest
from reporting import COMMAND, NAMES, PUPIL, calibrated, seen, written

from browser import find_browser
from omnisight.optics.models.axial import Axial
from omnisight.pipeline.noncentral import calibrate_rays
from omnisight.quality.noncentral_test import evaluate_noncentrality
from omnisight.report.report_data import Material
from omnisight.simulation import fisheye_setup


@pytest.fixture(scope="session")
def material(tmp_path_factory):
    """Give a calibration from ten images, of which a file could not be read and one shows no board."""
    search = seen(tmp_path_factory.mktemp("seen"))
    calibration = calibrated(search, model="kannala_brandt")
    camera = replace(calibration.camera, provenance={"tool": "omnisight", "images": ["1.png"]})
    names = [*NAMES, "torn.png", "empty.png"]
    return Material(calibration, search, camera, names, COMMAND, asked=evaluate_noncentrality(calibration, unit="m"))


@pytest.fixture(scope="session")
def axial(tmp_path_factory):
    """Give the calibration of a fisheye whose viewpoint moves, from as many images."""
    moving = Axial(fisheye_setup(640).camera.model, PUPIL)
    search = seen(tmp_path_factory.mktemp("axial"), project=moving.project)
    found = calibrate_rays(calibrated(search, model="kannala_brandt"), unit="m")
    names = [*NAMES, "torn.png", "empty.png"]
    return Material(found, search, found.camera, names, COMMAND, asked=found.trust.viewpoint)


@pytest.fixture(scope="session")
def axial_report(axial, tmp_path_factory):
    return written(axial, tmp_path_factory.mktemp("report") / "axial.html")


@pytest.fixture(scope="session")
def report(material, tmp_path_factory):
    return written(material, tmp_path_factory.mktemp("report") / "report.html")


@pytest.fixture(scope="session")
def browser():
    """Give a browser; the test skips where none is."""
    path = find_browser()
    if path is None:
        pytest.skip("needs a browser: Chromium or Chrome on the path, or OMNISIGHT_BROWSER=/path/to/one")
    from playwright.sync_api import sync_playwright

    quiet = ["--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=[*quiet, "--disable-sync", "--disable-gpu"])
        yield browser
        browser.close()


@pytest.fixture
def opened(browser):
    """Open a report and give its page; afterwards nothing may have been fetched, and nothing have gone wrong."""
    contexts, wrong = [], []

    def open_report(path, *, width=1280, height=800, **options):
        context = browser.new_context(viewport={"width": width, "height": height}, **options)
        contexts.append(context)
        page = context.new_page()
        address = path.as_uri()
        page.on("console", lambda message: wrong.append(message.text))
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("request", lambda r: None if r.url.startswith(("data:", address)) else wrong.append(r.url))
        page.goto(address)
        return page

    yield open_report
    for context in contexts:
        context.close()
    assert wrong == []
