"""What the tests of the report share: a calibration from known corners, and its report."""

import json
import re

import numpy as np

from omnisight.images import write_image
from omnisight.pipeline.central import calibrate_camera
from omnisight.report import write_report
from omnisight.simulation import fisheye_setup
from omnisight.targets import Detection, Detections, ImageDetection
from omnisight.targets.observations import Observations

NOISE = 0.1  # px
PUPIL = (0.012,)  # of the place on the axis of a viewpoint that moves, m
WRONG = 3.0  # px that one corner is off
NAMES = [f"img {i}.png" for i in range(1, 11)]
COMMAND = ["omnisight", "calibrate", "my images/*.png", "-o", "camera.json"]


def seen(folder, *, count=10, unread=True, project=None):
    """Give what would be found in images of a known fisheye, the first corner of all in a wrong place.

    `project` is that of another camera with images of that size.
    """
    setup = fisheye_setup(640)
    project = project or setup.camera.project
    noise = np.random.default_rng(1)
    pictures = []
    for i, board in enumerate(setup.boards(count)):
        pixels, valid = project(board.cam_from_board @ board.board.points)
        ids = np.flatnonzero(valid & setup.camera.in_image(pixels))
        pixels = pixels[ids] + noise.normal(0, NOISE, (len(ids), 2))
        pixels[0] += WRONG if i == 0 else 0
        path = folder / f"{i}.png"
        shade = np.linspace(0, 255, setup.camera.width, dtype=np.uint8)
        write_image(path, np.tile(shade, (setup.camera.height, 1)))
        covariance = np.tile(NOISE**2 * np.eye(2), (len(ids), 1, 1))
        detection = Detection(ids, pixels, covariance, board=board.board)
        pictures.append(ImageDetection(path, setup.camera.size, (detection,)))
    if unread:
        pictures.append(ImageDetection(folder / "torn.png", note="torn.png: empty file"))
        pictures.append(ImageDetection(folder / "0.png", setup.camera.size, note="no 8x5 board found"))
    return Detections(setup.boards(1)[0].board, pictures)


def calibrated(search, **options):
    return calibrate_camera(Observations.of_search(search), search.size, **options)


def written(material, path):
    """Write the report of a material, and give where it is."""
    m = material
    options = {"names": m.names, "command": m.command, "apply_exif": m.apply_exif, "asked": m.asked}
    write_report(m.calibration, m.search, m.camera, path, **options)
    return path


def data_of(text):
    """Give what a machine reads in the text of a report."""
    return json.loads(re.search(r'<script type="application/json" id="calibration">(.*?)</script>', text, re.DOTALL)[1])
