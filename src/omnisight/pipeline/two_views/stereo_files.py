"""Files of distances: 16-bit images, NumPy arrays, and point clouds."""

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.images import write_bytes, write_image

MAX_UINT16 = 65535
# Suffixes of distance images, and of exact distances.
IMAGE_SUFFIXES, ARRAY_SUFFIXES = (".png", ".tif", ".tiff"), (".npy", ".npz")
PLY_HEADER = """ply
format binary_little_endian 1.0
comment points in the frame of the left camera: x right, y down, z forward, in the unit of the rig
element vertex {count}
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
end_header
"""


def check_distance_suffix(path: Path) -> None:
    """Raise ValueError if distances cannot be written to a file of this suffix."""
    if path.suffix.lower() not in IMAGE_SUFFIXES + ARRAY_SUFFIXES:
        supported = " ".join(IMAGE_SUFFIXES + ARRAY_SUFFIXES)
        raise ValueError(
            f"{path}: distances cannot be written as {path.suffix or 'a file without a suffix'}: {supported}"
        )


def write_distances(path: Path, distance: NDArray[Any], sigma: NDArray[Any], steps: float) -> int:
    """Write distances (H, W) and, in an .npz file, their standard deviations; NaN is unknown.

    Parameters
    ----------
    path
        A .png or .tif file has 16 bits: steps per unit of length, 0 for unknown and for more than 65535 steps. An .npy
        file has the distances as float32, an .npz file the arrays `distance` and `sigma`; NaN is unknown.
    distance, sigma
        Distances and standard deviations.
    steps
        Steps per unit of length of a 16-bit image.

    Returns
    -------
    The number of distances that the file cannot hold.
    """
    check_distance_suffix(path)
    suffix = path.suffix.lower()
    if suffix in IMAGE_SUFFIXES:
        values = np.rint(np.nan_to_num(distance) * steps)
        fits = values <= MAX_UINT16
        write_image(path, np.where(fits, values, 0).astype(np.uint16))
        return int((~fits).sum())
    buffer = io.BytesIO()
    if suffix == ".npy":
        np.save(buffer, distance.astype(np.float32))
    else:
        np.savez_compressed(buffer, distance=distance.astype(np.float32), sigma=sigma.astype(np.float32))
    write_bytes(path, buffer.getvalue())
    return 0


def write_ply(path: Path, points: NDArray[np.float64], colors: NDArray[np.uint8]) -> None:
    """Write points (N, 3) with RGB colours (N, 3) as a binary PLY file."""
    vertices = np.empty(len(points), [("xyz", "<f4", 3), ("rgb", "u1", 3)])
    vertices["xyz"], vertices["rgb"] = points, colors
    write_bytes(path, PLY_HEADER.format(count=len(points)).encode() + vertices.tobytes())
