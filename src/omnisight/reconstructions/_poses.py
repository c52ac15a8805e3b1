"""Poses of the images of a reconstruction as arrays."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from omnisight.sfm.reconstruction import Reconstruction

Array = NDArray[np.float64]

# Directions whose mean is shorter have no common direction.
MIN_MEAN_LENGTH = 1e-3


def world_from_cameras(reconstruction: Reconstruction) -> tuple[Array, Array]:
    """Return the rotations (I, 3, 3) and the translations (I, 3) of world_from_cam of all images."""
    poses = [reconstruction.world_from_cam(image) for image in range(len(reconstruction))]
    return (
        np.array([pose.rotation for pose in poses]).reshape(-1, 3, 3),
        np.array([pose.translation for pose in poses]).reshape(-1, 3),
    )


def up_direction(reconstruction: Reconstruction) -> Array:
    """Return the direction (3,) of the world's up: z at a known place, or the mean of the upper sides of the images."""
    if reconstruction.origin is not None:
        return np.array([0.0, 0.0, 1.0])
    up = -world_from_cameras(reconstruction)[0][:, :, 1].sum(axis=0)
    length = float(np.linalg.norm(up))
    return up / length if length > MIN_MEAN_LENGTH * len(reconstruction) else np.array([0.0, -1.0, 0.0])


def marker_size(reconstruction: Reconstruction) -> float:
    """Return a size at which drawings of cameras do not overlap, in the unit of the world.

    A third of the median distance of a frame from the nearest other one; a fiftieth of the median distance of the
    points if all frames are in one place, 1 without points.
    """
    positions = np.array([pose.inverse().translation for pose in reconstruction.rig_from_world]).reshape(-1, 3)
    if len(positions) > 1:
        nearest, _ = KDTree(positions).query(positions, k=2)
        if (distance := float(np.median(nearest[:, 1]))) > 0:
            return distance / 3
    if not len(reconstruction.points) or not len(positions):
        return 1.0
    return float(np.median(np.linalg.norm(reconstruction.points.position - positions[0], axis=1))) / 50
