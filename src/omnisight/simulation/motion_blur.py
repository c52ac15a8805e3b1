"""Motion blur: the poses of the camera during the exposure at which rays are traced."""

import math
from typing import Any

import numpy as np

from omnisight.geometry.pose import Pose
from omnisight.simulation.camera_protocol import RenderableCamera
from omnisight.simulation.scene import Scene
from omnisight.simulation.trajectory import Motion

# Pixels along each side at which the length of the blur is measured.
GRID_SIDE = 12
# Of the lengths, because few pixels are very near.
QUANTILE = 0.95
# Longest step between two poses of an exposure, and blur that is too short to be rendered, px.
MAX_STEP_PX, MIN_BLUR_PX = 1.0, 0.1
# Limit of the cost: 16 times that of a sharp image with four rays.
MAX_POSES = 64


def exposure_times(
    camera: RenderableCamera,
    motion: Motion,
    rig_from_camera: Pose,
    scene: Scene,
    window: tuple[float, float],
    samples: int,
) -> list[float]:
    """Return the times at which rays are traced during an exposure; none if the image is sharp.

    Parameters
    ----------
    camera, rig_from_camera
        A camera of a moving rig.
    motion, scene
        The motion of the rig in the scene.
    window
        Middle and duration of the exposure, seconds.
    samples
        Rays per side of a pixel.
    """
    time, exposure = window
    if not exposure:
        return []
    begin, end = (motion.at(time + step * exposure) @ rig_from_camera for step in (-0.5, 0.5))
    return shutter_times(blur_length(camera, begin, end, scene), samples, time, exposure)


def shutter_times(length: float, samples: int, time: float, exposure: float) -> list[float]:
    """Return the times at which rays are traced; none for a sharp image.

    Parameters
    ----------
    length
        Of the blur, px.
    samples
        Rays per side of a pixel. The number of times is a multiple of its square: all rays have the same weight.
    time, exposure
        Middle and duration of the exposure, seconds.
    """
    if length < MIN_BLUR_PX:
        return []
    rays = samples**2
    count = min(rays * math.ceil(length / MAX_STEP_PX / rays), max(MAX_POSES // rays, 1) * rays)
    return [time + exposure * ((k + 0.5) / count - 0.5) for k in range(count)]


def blur_length(camera: RenderableCamera, begin: Pose, end: Pose, scene: Scene) -> float:
    """Return the length, px, of the blur between two poses world_from_cam: the 95 % quantile of the image."""
    u, v = (np.linspace(0, side - 1, min(side, GRID_SIDE)) for side in camera.size)
    pixels = np.stack(np.meshgrid(u, v), -1).reshape(-1, 2)
    rays: Any = camera.rays(pixels)
    pixels, origins, bearings = (array[rays.valid] for array in (pixels, rays.origins, rays.bearings))
    if not len(pixels):
        return 0.0
    hits = scene.cast(begin @ origins, bearings @ begin.rotation.T)
    # Sky and open space are far away: only the rotation matters.
    distance = np.where(np.isnan(hits.distances), 1e6, hits.distances)
    points = begin @ (origins + distance[:, None] * bearings)
    moved, valid = camera.project(end.inverse() @ points)
    lengths = np.linalg.norm(moved - pixels, axis=1)[valid]
    # Across the seam of a panorama.
    width = camera.size[0]
    lengths = np.minimum(lengths, np.abs(width - lengths))
    return float(np.quantile(lengths, QUANTILE)) if len(lengths) else 0.0
