"""Sampling of the image of one camera of a rig at directions of the rig."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.geometry.pose import Pose
from omnisight.parallel import parallel_map
from omnisight.views.frame_remapper import pyramid_level

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]

# Coordinate of directions that the camera does not see; far outside every image.
OUTSIDE_PX = -9999.0
# Rows of directions held in double precision at a time.
CHUNK_ROWS = 64
# Step between the pixels among which the farthest from the principal point is searched.
RADIUS_STEP_PX = 8
# Reduction (log2) from which images are sampled from a pyramid: below, bilinear interpolation uses every pixel of the
# image. A sphere at full resolution has 0.65 at 90 degrees from an axis, but only tangentially: a pyramid would blur
# radially too.
MIN_REDUCTION_LEVEL = 1.0


class Warp(Protocol):
    """A small change of directions."""

    def __call__(self, bearings: Array) -> Array:
        """Return the directions (..., 3), unit vectors, at which to sample instead."""
        ...


@dataclass(frozen=True, eq=False)
class Sampler:
    """A camera, as seen from the origin of the rig.

    Attributes
    ----------
    camera, sensor_from_rig
        The camera and its pose.
    allowed
        (H, W) which pixels of its images to use.
    distance
        Radius of the sphere on which the scene is assumed, in the unit of the rig; infinite without parallax.
    warps
        Local warps, applied in turn.
    """

    camera: Camera
    sensor_from_rig: Pose
    allowed: Mask
    distance: float = float("inf")
    warps: tuple[Warp, ...] = ()

    @property
    def axis(self) -> Array:
        """Direction (3,) of the optical axis in the rig frame."""
        return self.sensor_from_rig.rotation[2]

    def relative_radius(self, pixels: NDArray[Any]) -> Array:
        """Return distances of pixels (..., 2) from the principal point, relative to the farthest allowed pixel."""
        return np.hypot(pixels[..., 0] - self._centre[0], pixels[..., 1] - self._centre[1]) / self._largest_radius

    @cached_property
    def _centre(self) -> tuple[float, float]:
        model: Any = self.camera.model
        width, height = self.camera.size
        return getattr(model, "cx", (width - 1) / 2), getattr(model, "cy", (height - 1) / 2)

    @cached_property
    def _largest_radius(self) -> float:
        rows, columns = RADIUS_STEP_PX * np.array(np.nonzero(self.allowed[::RADIUS_STEP_PX, ::RADIUS_STEP_PX]))
        radii = np.hypot(columns - self._centre[0], rows - self._centre[1])
        return float(radii.max(initial=0)) or max(self.camera.size) / 2

    def map(self, bearings: NDArray[Any]) -> tuple[Floats, Floats, Mask]:
        """Return the pixels u, v (H, W) of directions (H, W, 3), and which of them are seen and allowed."""
        import cv2

        shape = bearings.shape[:2]
        u, v = np.empty(shape, np.float32), np.empty(shape, np.float32)

        def work(start: int) -> None:
            rows = slice(start, start + CHUNK_ROWS)
            pixels = self._pixels(np.asarray(bearings[rows], float))
            u[rows], v[rows] = pixels[..., 0], pixels[..., 1]

        parallel_map(work, range(0, shape[0], CHUNK_ROWS))
        allowed = np.asarray(self.allowed, np.uint8)
        return u, v, cv2.remap(allowed, u, v, cv2.INTER_NEAREST, borderValue=(0.0,)) > 0

    def _pixels(self, directions: Array) -> Array:
        """Return the pixels (..., 2) of directions (..., 3); OUTSIDE_PX where the camera does not see them."""
        for warp in self.warps:
            directions = warp(directions)
        points = directions @ self.sensor_from_rig.rotation.T
        if np.isfinite(self.distance):
            points = self.distance * points + self.sensor_from_rig.translation
        pixels, valid = self.camera.project(points)
        seen = valid & self.camera.in_image(pixels) & self.camera.calibrated(points)
        return np.where(seen[..., None], pixels, OUTSIDE_PX)


@dataclass(frozen=True, eq=False)
class PolarGrid:
    """Directions around an axis: rows are angles from the axis, columns are azimuths of the whole circle.

    Attributes
    ----------
    rig_from_axis
        (3, 3) rotation whose last column is the axis.
    theta
        (R,) angles of the rows, radians.
    columns
        Number of azimuths.
    """

    rig_from_axis: Array
    theta: Array
    columns: int

    @classmethod
    def around(cls, axis: Array, low: float, high: float, columns: int) -> "PolarGrid":
        """Return a grid with square pixels at 90 degrees from the axis."""
        rows = max(8, int(np.ceil((high - low) * columns / (2 * np.pi))))
        basis = np.linalg.svd(axis[None])[2][1:]
        if np.linalg.det(np.column_stack([*basis, axis])) < 0:
            basis = basis[::-1]
        return cls(np.column_stack([*basis, axis]), low + (np.arange(rows) + 0.5) * (high - low) / rows, columns)

    @property
    def px_per_rad(self) -> float:
        """Rows per radian."""
        return self.columns / (2 * np.pi)

    def bearings(self) -> Array:
        """Return the directions (R, C, 3) in the rig frame."""
        phi = (np.arange(self.columns) + 0.5) * 2 * np.pi / self.columns
        sine = np.sin(self.theta)[:, None]
        local = np.stack(
            [
                sine * np.cos(phi),
                sine * np.sin(phi),
                np.broadcast_to(np.cos(self.theta)[:, None], (len(sine), len(phi))),
            ],
            -1,
        )
        return local @ self.rig_from_axis.T

    def coordinates(self, bearings: NDArray[Any]) -> tuple[Array, Array]:
        """Return the angle from the axis and the column (fractional) of directions (..., 3)."""
        local = bearings @ self.rig_from_axis
        theta = np.arctan2(np.hypot(local[..., 0], local[..., 1]), local[..., 2])
        phi = np.arctan2(local[..., 1], local[..., 0]) % (2 * np.pi)
        return theta, phi * self.px_per_rad - 0.5


def reduction_level(camera: Camera, u: Floats, v: Floats, seen: Mask) -> Floats | None:
    """Return the pyramid level (H, W) at which to sample pixels u, v of an image; None if nowhere much smaller."""
    visible = [np.where(seen, m, np.float32(np.nan)) for m in (u, v)]
    level = pyramid_level(camera, visible[0], visible[1], seen)
    return None if level is None or level[seen].max(initial=0) < MIN_REDUCTION_LEVEL else level
