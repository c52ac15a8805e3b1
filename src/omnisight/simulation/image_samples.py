"""Samples of rendered images on a sparse grid, from which co-visibility and sparse points are computed."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.rig import Sensor
from omnisight.simulation.rendered import GroundTruth

Array = NDArray[np.float64]

# Sampled pixels along the longer side of an image, and of its reduced depth map.
GRID_SIDE, DEPTH_MAP_SIDE = 16, 160


@dataclass(frozen=True, eq=False)
class ImageSample:
    """Ground truth of an image at few pixels.

    Attributes
    ----------
    pixels
        (G, 2) of the grid that show a static surface.
    points
        (G, 3) of these pixels in the world.
    colors
        (G, 3) uint8 of these pixels.
    depth
        (h, w) float32, each `step`-th pixel of the depth.
    step
        Pixels between the samples of the depth.
    """

    pixels: Array
    points: Array
    colors: NDArray[np.uint8]
    depth: NDArray[np.float32]
    step: int

    @classmethod
    def of(cls, image: NDArray[np.uint8], truth: GroundTruth, moving: NDArray[np.bool_]) -> "ImageSample":
        """Sample an image (H, W, 3) and its ground truth, without points on what moves (H, W)."""
        longer = max(truth.depth.shape)
        step, spacing = max(1, -(-longer // DEPTH_MAP_SIDE)), max(1, -(-longer // GRID_SIDE))
        grid = np.zeros(truth.depth.shape, np.bool_)
        grid[spacing // 2 :: spacing, spacing // 2 :: spacing] = True
        rows, columns = np.nonzero(grid & ~np.isnan(truth.depth) & ~moving)
        pixels = np.column_stack([columns, rows]).astype(float)
        depth = truth.depth[::step, ::step].astype(np.float32)
        return cls(pixels, truth.points[rows, columns], image[rows, columns], depth, step)


@dataclass(frozen=True)
class SampledView:
    """A camera at a pose with the sample of its image."""

    camera: Sensor
    world_from_cam: Pose
    sample: ImageSample

    def locate(self, points: Array, farther: float, nearer: float = np.inf) -> tuple[Array, NDArray[np.bool_]]:
        """Project points (N, 3) of the world; return pixels (N, 2) and which points the image shows.

        A point is hidden if the depth map is nearer by more than the share `farther` of its distance, and on another
        surface if the map is farther by more than the share `nearer`.
        """
        local = self.world_from_cam.inverse() @ points
        pixels, valid = self.camera.project(local)
        size = np.array(self.camera.size)
        with np.errstate(invalid="ignore"):
            valid = valid & ((pixels >= -0.5) & (pixels < size - 0.5)).all(-1)
        at = np.rint(np.where(valid[:, None], pixels, 0) / self.sample.step).astype(np.intp)
        rows, columns = (np.minimum(at[:, 1 - k], self.sample.depth.shape[k] - 1) for k in range(2))
        seen, distance = self.sample.depth[rows, columns], np.linalg.norm(local, axis=-1)
        with np.errstate(invalid="ignore"):
            # No depth, such as outside the image circle, is False.
            shown = (seen >= distance * (1 - farther)) & (seen <= distance * (1 + nearer))
        return pixels, valid & shown
