"""Which part of the field of view of a camera the other cameras of a rig see."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.geometry.pose import Pose
from omnisight.geometry.sphere import cap
from omnisight.ray_camera import RayCamera

Array = NDArray[np.float64]
Sensor = Camera | RayCamera

# Rings of sampled bearings, 0.9 degrees apart: about 51,000, so the share of a field of view of 60 degrees has a
# standard error below 1 %.
RINGS = 200
# Points at infinity, as a multiple of the largest baseline: the parallax is below a thousandth of the sampling.
FAR_BASELINES = 1e6


def overlap(cameras: Sequence[Sensor], poses: Sequence[Pose], distance: float) -> Array:
    """Return (C, C) the share of the field of view of camera i (row) that camera j (column) sees.

    Parameters
    ----------
    cameras, poses
        The cameras and their `sensor_from_rig`.
    distance
        Distance of the scene from camera i, in the unit of the poses; inf for directions only.

    Raises
    ------
    ValueError
        If the distance is not positive.
    """
    if not distance > 0:
        raise ValueError(f"the distance must be positive, got {distance:g}")
    centres = np.stack([pose.inverse().translation for pose in poses])
    longest = float(np.linalg.norm(centres[:, None] - centres, axis=2).max())
    length = distance if np.isfinite(distance) else FAR_BASELINES * max(longest, 1.0)
    points = length * cap(np.pi, RINGS)
    share = np.full((len(cameras), len(cameras)), np.nan)
    for i, (camera, pose) in enumerate(zip(cameras, poses, strict=True)):
        seen = points[sees(camera, points)]
        if not len(seen):
            continue
        in_rig = pose.inverse() @ seen
        share[i] = [sees(other, other_pose @ in_rig).mean() for other, other_pose in zip(cameras, poses, strict=True)]
    return share


def sees(camera: Sensor, points: Array) -> NDArray[np.bool_]:
    """Return which points (..., 3) of the camera frame are in the image and in the calibrated field of view."""
    pixels, valid = camera.project(points)
    angle = np.arctan2(np.hypot(points[..., 0], points[..., 1]), points[..., 2])
    limit = np.pi if camera.theta_max is None else camera.theta_max
    return valid & camera.in_image(pixels) & (angle >= camera.theta_min) & (angle <= limit)
