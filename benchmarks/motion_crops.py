"""What a wide field of view gains: odometry on perspective views of the same images.

`python -m benchmarks motion --crops` tracks each sequence with the whole images, and with views ahead of 60°, 90° and
120° that have the same resolution in their centre.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import omnisight as om
from benchmarks.motion_score import errors
from omnisight.geometry.pose import Pose

FPS = 10.0
FIELDS_DEG = (120.0, 90.0, 60.0)
# Share of the images that must have a pose.
MIN_COVERAGE = 0.99
HEADER = "| sequence | images | with a pose | error | drift | drift °/m |\n|---|---|---|---|---|---|"


def print_crops(label: str, folder: Path, true: Sequence[Pose]) -> None:
    """Print the rows of the images of a folder, and of views of them."""
    camera = om.load(folder / "camera.json")
    paths = sorted((folder / "images").iterdir())
    print(row(label, "whole", camera, map(om.read_image, paths), true), flush=True)
    for field in FIELDS_DEG:
        side = 2 * round(pixels_per_radian(camera) * np.tan(np.radians(field / 2)))
        view = om.perspective((side, side), field)
        crops = (om.remap(om.read_image(path), camera, view) for path in paths)
        print(row(label, f"{field:.0f}°, {side} px", view, crops, true), flush=True)


def pixels_per_radian(camera: om.Camera) -> float:
    """Return the resolution of a camera along its axis."""
    step = 1e-3
    ends, _ = camera.project(np.array([[-step / 2, 0.0, 1.0], [step / 2, 0.0, 1.0]]))
    return float(np.linalg.norm(ends[1] - ends[0]) / step)


def row(label: str, name: str, camera: om.Camera, images: Iterable[NDArray[Any]], true: Sequence[Pose]) -> str:
    """Return the row of the images of a camera."""
    tracking, count = om.Odometry(camera, om.MotionOptions(loops=False)), 0
    for count, image in enumerate(images, 1):
        tracking.add(image, (count - 1) / FPS)
    tracking.finish()
    coverage = len(tracking.trajectory) / count
    segments = 1 + sum(lost.recovery == "new segment" for lost in tracking.lost)
    if coverage < MIN_COVERAGE or segments > 1:
        parts = "1 segment" if segments == 1 else f"{segments} segments"
        return f"| {label} | {name} | failed: {coverage:.0%} in {parts} | | | |"
    found = [pose.rig_from_world.inverse() for pose in tracking.trajectory]
    score = errors(found, [true[pose.frame] for pose in tracking.trajectory])
    figures = f"{score.position:.3%} | {score.drift:.3%} | {score.drift_deg_per_m:.4f}"
    return f"| {label} | {name} | {coverage:.0%} | {figures} |"
