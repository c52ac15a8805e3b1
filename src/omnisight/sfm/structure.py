"""Rays of points, and the poses and points that explain them."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from omnisight.parallel import parallel_for

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Observations per task of a thread.
RAYS_PER_TASK = 16384
# Least distance of a point from a ray's origin, relative to its largest one, below which they coincide.
MIN_DISTANCE_RATIO = 1e-4


@dataclass(frozen=True, eq=False)
class RayObservations:
    """Observed rays of points, sorted by point.

    Attributes
    ----------
    frame, sensor, point
        (M,) indices.
    origins, bearings
        (M, 3) of the rays, in the frames of the sensors.
    axes
        (M, 2, 3) tangents along which bearings have unit variance and no correlation.
    """

    frame: Indices
    sensor: Indices
    point: Indices
    origins: Array
    bearings: Array
    axes: Array

    def __len__(self) -> int:
        """Return the number of observations."""
        return len(self.point)

    def __getitem__(self, use: NDArray[np.bool_] | Indices) -> "RayObservations":
        """Return the observations of a mask or of indices, which must stay sorted by point."""
        return RayObservations(
            self.frame[use], self.sensor[use], self.point[use], self.origins[use], self.bearings[use], self.axes[use]
        )


@dataclass(frozen=True, eq=False)
class Structure:
    """Poses and points.

    Attributes
    ----------
    rig_from_world
        (F, 3, 4) poses of the frames.
    sensor_from_rig
        (S, 3, 4) poses of the sensors.
    points
        (P, 3) in the world frame.
    values
        (Q,) of free cameras, see `FreeCameras`; none if the cameras are fixed.
    """

    rig_from_world: Array
    sensor_from_rig: Array
    points: Array
    values: Array = field(default_factory=lambda: np.zeros(0))

    def squared_residuals(self, rays: RayObservations) -> Array:
        """Return the squared lengths (M,) of the whitened residuals; inf for points behind their rays."""
        from omnisight.sfm._bundle_kernel import squared_lengths

        squares, indices = np.empty(len(rays)), (rays.frame, rays.sensor, rays.point)
        poses = self.rig_from_world, self.sensor_from_rig
        parallel_for(
            lambda first, last: squared_lengths(
                *poses, self.points, *indices, rays.origins, rays.bearings, rays.axes, first, last, squares
            ),
            len(rays),
            RAYS_PER_TASK,
        )
        return squares

    def directions(self, rays: RayObservations) -> Array:
        """Return the unit directions (M, 3) of the points from the origins of their rays."""
        offsets = self._from_origins(rays)
        return offsets / np.maximum(np.linalg.norm(offsets, axis=1, keepdims=True), np.finfo(float).tiny)

    def distances(self, rays: RayObservations) -> Array:
        """Return the distances (M,) of the points from the origins of their rays."""
        return np.linalg.norm(self._from_origins(rays), axis=1)

    def _from_origins(self, rays: RayObservations) -> Array:
        """Return the positions (M, 3) of the points relative to the origins of their rays."""
        of_frame, of_sensor = self.rig_from_world[rays.frame], self.sensor_from_rig[rays.sensor]
        in_rig = np.einsum("mij,mj->mi", of_frame[:, :, :3], self.points[rays.point]) + of_frame[:, :, 3]
        in_sensor = np.einsum("mij,mj->mi", of_sensor[:, :, :3], in_rig) + of_sensor[:, :, 3]
        return in_sensor - rays.origins

    def coincide_with_cameras(self, rays: RayObservations) -> NDArray[np.bool_]:
        """Return which points (P,) are at a camera: any motion of the camera around them changes their direction."""
        distances, count = self.distances(rays), len(self.points)
        nearest, farthest = np.full(count, np.inf), np.zeros(count)
        np.minimum.at(nearest, rays.point, distances)
        np.maximum.at(farthest, rays.point, distances)
        return nearest < MIN_DISTANCE_RATIO * farthest
