"""Shared by the tests of the report: calibrations from synthetic corners, and their reports."""

import json
import re
from dataclasses import replace

import numpy as np

from omnisight.images import write_image
from omnisight.pipeline.calibration.calibrate import CalibrateOptions, calibrate
from omnisight.report.page import render_page
from omnisight.report.report_data import ReportData, ReportOptions
from omnisight.simulation import fisheye_setup
from omnisight.targets import Detection, Detections, ImageDetection
from omnisight.targets.observations import Observations

NOISE_PX = 0.1
# Pupil coefficient of the simulated axial camera, m.
PUPIL = (0.012,)
# Error of the one wrong corner along u and v.
WRONG_PX = 3.0
NAMES = [f"img {i}.png" for i in range(1, 11)]
COMMAND = ["omnisight", "calibrate", "my images/*.png", "-o", "camera.json"]
UNUSED_NAMES = ["torn.png", "empty.png"]


def simulate_detections(folder, *, count=10, unused=True, project=None):
    """Return detections in `count` images of a fisheye camera; the first corner of all is wrong.

    Two more images have no board if `unused`. `project` replaces the projection of the camera.
    """
    setup = fisheye_setup(640)
    project = project or setup.camera.project
    rng = np.random.default_rng(1)
    images = []
    for i, board in enumerate(setup.boards(count)):
        pixels, valid = project(board.cam_from_board @ board.board.points)
        ids = np.flatnonzero(valid & setup.camera.in_image(pixels))
        pixels = pixels[ids] + rng.normal(0, NOISE_PX, (len(ids), 2))
        pixels[0] += WRONG_PX if i == 0 else 0
        path = folder / f"{i}.png"
        ramp = np.linspace(0, 255, setup.camera.width, dtype=np.uint8)
        write_image(path, np.tile(ramp, (setup.camera.height, 1)))
        covariance = np.tile(NOISE_PX**2 * np.eye(2), (len(ids), 1, 1))
        detection = Detection(ids, pixels, covariance, board=board.board)
        images.append(ImageDetection(path, setup.camera.size, (detection,)))
    if unused:
        images.append(ImageDetection(folder / "torn.png", note="torn.png: empty file"))
        images.append(ImageDetection(folder / "0.png", setup.camera.size, note="no 8x5 board found"))
    return Detections(setup.boards(1)[0].board, images)


def calibrate_detections(detections, names=None, **options):
    """Calibrate from detections without re-detection, since the images show no board."""
    observations = Observations.from_detections(detections, names)
    calibration = calibrate(replace(observations, detections=None), CalibrateOptions(**options))
    return replace(calibration, observations=observations)


def report_data(calibration, command=COMMAND):
    return ReportData(calibration, ReportOptions(command))


def with_quality(data, **changes):
    """Return report data with changed fields of the quality report."""
    quality = replace(data.calibration.quality, **changes)
    return replace(data, calibration=replace(data.calibration, quality=quality))


def with_observations(data, **changes):
    """Return report data with changed fields of the observations."""
    observations = replace(data.observations, **changes)
    return replace(data, calibration=replace(data.calibration, observations=observations))


def with_images(data, images):
    """Return report data with changed detection results."""
    return with_observations(data, detections=replace(data.detections, images=images))


def write(data, path):
    """Write the report and return its path."""
    path.write_text(render_page(data), "utf-8", "replace")
    return path


def section(text, name):
    """Return the HTML text of a section."""
    return re.search(rf'<section id="{name}".*?</section>', text, re.DOTALL)[0]


def embedded_json(text):
    """Return the embedded JSON object of a report."""
    return json.loads(re.search(r'<script type="application/json" id="calibration">(.*?)</script>', text, re.DOTALL)[1])


def contains_nan(text):
    return re.search(r"\bnan\b", re.sub(r"base64,[^\"]*", "", text), re.IGNORECASE) is not None
