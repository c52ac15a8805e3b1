"""Cells of equal solid angle, to distribute points evenly over the directions and not over the pixels."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.geometry.sphere import angle_from_axis

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class SolidAngleCells:
    """Rings about the axis of a camera, cut into cells of nearly equal solid angle.

    Attributes
    ----------
    of_pixel
        (H, W) int32, cell of each pixel; -1 where it has no direction, or is masked.
    count
        Number of cells of the whole sphere.
    used
        Number of cells with pixels.
    """

    of_pixel: NDArray[np.int32]
    count: int
    used: int

    @classmethod
    def of(cls, camera: Camera, region: Mask, wanted: int) -> "SolidAngleCells":
        """Divide a region (H, W) of the image of a camera into about as many cells as wanted."""
        bearings = _pixel_bearings(camera)
        seen = region & np.isfinite(bearings[..., 0])
        weight = _solid_angles(bearings)
        total = float(weight[seen].sum())
        side = np.sqrt(total / max(wanted, 1))
        rings = max(round(float(np.pi / side)), 1)
        edges = np.pi * np.arange(rings + 1) / rings
        areas = 2 * np.pi * (np.cos(edges[:-1]) - np.cos(edges[1:]))
        per_ring = np.maximum(np.round(areas / side**2), 1).astype(int)
        first = np.concatenate([[0], np.cumsum(per_ring)])
        with np.errstate(invalid="ignore"):
            theta = np.nan_to_num(angle_from_axis(bearings.astype(float)))
            turn = np.nan_to_num(np.arctan2(bearings[..., 1], bearings[..., 0])) / (2 * np.pi) + 0.5
        ring = np.minimum((theta / np.pi * rings).astype(int), rings - 1)
        cell = first[ring] + np.minimum((turn * per_ring[ring]).astype(int), per_ring[ring] - 1)
        used = len(np.unique(cell[seen]))
        return cls(np.where(seen, cell, -1).astype(np.int32), int(first[-1]), used)

    def at(self, pixels: Array) -> NDArray[np.int32]:
        """Return the cells (N,) of pixels (N, 2); -1 outside the region."""
        height, width = self.of_pixel.shape
        column, row = np.rint(pixels).astype(int).T
        inside = (column >= 0) & (row >= 0) & (column < width) & (row < height)
        return np.where(inside, self.of_pixel[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)], -1)


@lru_cache(maxsize=4)
def _pixel_bearings(camera: Camera) -> NDArray[np.float32]:
    """Return the bearings (H, W, 3) of all pixels; NaN where there is none."""
    found = np.empty((camera.height, camera.width, 3), np.float32)
    for row in range(camera.height):
        pixels = np.stack([np.arange(camera.width), np.full(camera.width, row)], -1)
        found[row] = camera.rays(pixels).bearings
    return found


def _solid_angles(bearings: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the solid angles (H, W) of pixels, from their neighbours; 0 where these are not all known."""
    padded = np.pad(bearings, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    along_u = (padded[1:-1, 2:] - padded[1:-1, :-2]) / 2
    along_v = (padded[2:, 1:-1] - padded[:-2, 1:-1]) / 2
    return np.nan_to_num(np.linalg.norm(np.cross(along_u, along_v), axis=-1)).astype(np.float32)
