"""Calibrations with their reports, and a browser that opens them."""

import pytest

from omnisight.optics.models.axial import Axial
from omnisight.report.page import write_report
from omnisight.report.report_data import ReportOptions
from omnisight.simulation import fisheye_setup
from reporting import COMMAND, NAMES, PUPIL, UNUSED_NAMES, calibrate_detections, report_data, simulate_detections, write

# A message about the time of a screenshot.
SLOW_GL = "GL Driver Message (OpenGL, Performance"


@pytest.fixture(scope="session")
def central(tmp_path_factory):
    """Return the data of a central calibration from ten images; one more is unreadable, one has no board."""
    detections = simulate_detections(tmp_path_factory.mktemp("images"))
    return report_data(calibrate_detections(detections, [*NAMES, *UNUSED_NAMES], model="kannala_brandt"))


@pytest.fixture(scope="session")
def axial(tmp_path_factory):
    """Return the data of an axial calibration of a fisheye with entrance pupil shift, from as many images."""
    camera = Axial(fisheye_setup(640).camera.model, PUPIL)
    detections = simulate_detections(tmp_path_factory.mktemp("axial"), project=camera.project)
    return report_data(calibrate_detections(detections, [*NAMES, *UNUSED_NAMES], model="axial"))


@pytest.fixture(scope="session")
def axial_report(axial, tmp_path_factory):
    return write(axial, tmp_path_factory.mktemp("report") / "axial.html")


@pytest.fixture(scope="session")
def report(central, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(central.calibration, path, ReportOptions(COMMAND))
    return path


@pytest.fixture
def opened(browser):
    """Return a function that opens a report; afterwards, check for network requests and console messages."""
    contexts, problems = [], []

    def open_report(path, *, width=1280, height=800, **options):
        context = browser.new_context(viewport={"width": width, "height": height}, **options)
        contexts.append(context)
        page = context.new_page()
        address = path.as_uri()
        page.on("console", lambda message: None if SLOW_GL in message.text else problems.append(message.text))
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("request", lambda r: None if r.url.startswith(("data:", address)) else problems.append(r.url))
        page.goto(address)
        return page

    yield open_report
    for context in contexts:
        context.close()
    assert problems == []
