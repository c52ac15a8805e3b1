"""What the viewer of a reconstruction draws, as one JSON object with arrays as base64."""

import base64
import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.reconstructions import marker_size, up_direction
from omnisight.report.jpeg_url import jpeg_url
from omnisight.rig import Sensor
from omnisight.sfm.reconstruction import Reconstruction

# Limits of what is embedded: 200,000 points take 4 MB, 400,000 observations 9 MB, 16 megapixels of JPEG about 4 MB.
MAX_POINTS, MAX_OBSERVATIONS = 200_000, 400_000
MAX_TOTAL_PIXELS, MAX_IMAGE_PIXELS = 16_000_000, 1_000_000
# Cells of the grid of an image whose corners have exact bearings. Between them the error is below 0.02 degrees.
GRID_CELLS = 128


def viewer_data(reconstruction: Reconstruction, images: Path | None, *, apply_exif: bool = False) -> dict[str, Any]:
    """Return the JSON object.

    Coordinates are relative to `origin`, the median position of the cameras, because 32-bit floats resolve a micrometre
    only near zero.

    Parameters
    ----------
    reconstruction
        The reconstruction.
    images
        The folder of the images, or None to draw the cameras without them.
    apply_exif
        Rotate images by their EXIF orientation.
    """
    poses = [reconstruction.world_from_cam(image) for image in range(len(reconstruction))]
    positions = np.array([pose.translation for pose in poses]).reshape(-1, 3)
    origin = np.median(positions, axis=0) if len(positions) else np.zeros(3)
    urls = _thumbnails(reconstruction, images, apply_exif)
    return {
        "unit": "m" if reconstruction.has_scale else "units",
        "up": up_direction(reconstruction).tolist(),
        "marker": marker_size(reconstruction),
        "sensors": [
            {"name": name, **_sensor_data(camera)}
            for name, camera in zip(reconstruction.rig.names, reconstruction.rig.cameras, strict=True)
        ],
        "cameras": [
            {
                "name": name,
                "sensor": int(reconstruction.sensor[image]),
                "rotation": pose.rotation.ravel().tolist(),
                "position": (pose.translation - origin).tolist(),
                "image": url,
            }
            for image, (name, pose, url) in enumerate(zip(reconstruction.names, poses, urls, strict=True))
        ],
        **_point_data(reconstruction, origin),
    }


def _point_data(reconstruction: Reconstruction, origin: NDArray[np.float64]) -> dict[str, Any]:
    """Return the points and their observations: those with the most observations if there are too many."""
    points, observations = reconstruction.points, reconstruction.observations
    count = np.bincount(observations.point, minlength=len(points))
    longest = np.argsort(-count, kind="stable")
    kept = np.sort(longest[:MAX_POINTS][np.cumsum(count[longest[:MAX_POINTS]]) <= MAX_OBSERVATIONS])
    rank = np.full(len(points), -1)
    rank[kept] = np.arange(len(kept))
    rows = np.flatnonzero(rank[observations.point] >= 0)
    rows = rows[np.argsort(rank[observations.point[rows]], kind="stable")]
    lengths = np.linalg.norm(observations.residuals[rows], axis=1)
    return {
        "points": len(points),
        "index": _encode(kept, "<u4"),
        "position": _encode(points.position[kept] - origin, "<f4"),
        "color": _encode(points.color[kept], "u1"),
        "first": _encode(np.concatenate([[0], np.cumsum(count[kept])]), "<u4"),
        "observed": _encode(observations.image[rows], "<u4"),
        "pixel": _encode(observations.pixels[rows], "<f4"),
        "residual": _encode(lengths, "<f4"),
    }


def _sensor_data(camera: Sensor) -> dict[str, Any]:
    """Return the bearings of a grid over the image of a camera; zero where it has none."""
    width, height = camera.size
    columns, rows = (np.linspace(-0.5, side - 0.5, GRID_CELLS + 1) for side in (width, height))
    bearings = camera.rays(np.stack(np.meshgrid(columns, rows), -1)).bearings
    return {
        "cells": GRID_CELLS,
        "bearings": _encode(np.nan_to_num(bearings), "<f4"),
        "maxCosine": math.cos(camera.theta_min),
        "minCosine": -1.0 if camera.theta_max is None else math.cos(camera.theta_max),
    }


def _thumbnails(reconstruction: Reconstruction, images: Path | None, apply_exif: bool) -> Sequence[str | None]:
    """Return the images as data URLs at reduced size; None for those that cannot be read."""
    if images is None:
        return [None] * len(reconstruction)
    pixels = min(MAX_IMAGE_PIXELS, MAX_TOTAL_PIXELS // max(1, len(reconstruction)))
    sizes = [camera.size for camera in reconstruction.rig.cameras]
    widths = [max(1, min(width, int(math.sqrt(pixels * width / height)))) for width, height in sizes]
    paths = [images / PurePosixPath(name) for name in reconstruction.names]
    with ThreadPoolExecutor(max_workers=min(8, os.cpu_count() or 1)) as pool:
        sizes = [widths[sensor] for sensor in reconstruction.sensor.tolist()]
        return list(pool.map(jpeg_url, paths, sizes, [apply_exif] * len(paths)))


def _encode(values: NDArray[Any], kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode()
