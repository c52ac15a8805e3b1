"""A board file with another gap between markers than the print is recognized, and the right gap is named."""

import dataclasses
import re
from types import SimpleNamespace

import numpy as np
import pytest

import omnisight as om
from calibrating import SIZE, calibrate, observe
from lenses import lens
from omnisight.geometry import rotation as so3
from omnisight.quality.checks.marker_spacing import check
from omnisight.quality.evidence import Evidence, Level
from omnisight.targets.boards.aprilgrid import AprilGrid
from omnisight.targets.boards.aruco_grid import ArucoGrid


def checked(printed, specified):
    """Return the check of a camera that is calibrated from images of a print with the file of another board."""
    truth, rng, views = lens(140), np.random.default_rng(0), []
    for _ in range(12):
        rotation = so3.exp(rng.uniform(-0.5, 0.5, 3))
        middle = np.append(rng.uniform(-0.25, 0.25, 2), rng.uniform(0.3, 0.5))
        points = (printed.points - printed.points.mean(0)) @ rotation.T + middle
        views.append((specified.points, truth.project_numpy(points)[0] + rng.normal(0, 0.1, (len(points), 2))))
    calibration = calibrate(observe(views, SIZE), model="equisolid")
    observations = dataclasses.replace(calibration.observations, detections=om.Detections(specified))
    outliers = np.zeros(len(observations.pixels), bool)
    evidence = SimpleNamespace(observations=observations, outliers=outliers, candidate=calibration.best, px_scale=1.0)
    evidence.grade = lambda value, limits: Evidence.grade(evidence, value, limits)
    return check(evidence)


@pytest.mark.parametrize(
    ("printed", "specified", "level", "text"),
    [
        (AprilGrid(6, 6, 0.03, 0.3), AprilGrid(6, 6, 0.03, 0.25), 2, "is 0.3.. of the side of a marker, not 0.25 "),
        (AprilGrid(6, 6, 0.03, 0.2), AprilGrid(6, 6, 0.03, 0.3), 2, "is 0.2.. .* not 0.3 .* correct the spacing"),
        (AprilGrid(6, 6, 0.03, 0.3), AprilGrid(6, 6, 0.03, 0.275), 1, "is 0.3.. of .* not 0.275 "),
        (AprilGrid(6, 6, 0.03, 0.3), AprilGrid(6, 6, 0.04, 0.3), 0, "^$"),
        (ArucoGrid(6, 5, 0.03, 0.006), ArucoGrid(6, 5, 0.03, 0.0075), 1, "is 0.20. .* not 0.25 .* the separation"),
    ],
    ids=str,
)
def test_another_gap_between_markers_is_named(printed, specified, level, text):
    result = checked(printed, specified)
    assert result.level == Level(level)
    assert re.search(text, result.sentence)
