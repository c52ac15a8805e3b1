"""Rigs of central cameras, and whether they determine the scale."""

from dataclasses import replace

import numpy as np

from omnisight.camera import Camera
from omnisight.geometry.pose import Pose
from omnisight.ray_camera import RayCamera
from omnisight.rig import Rig


def central_rig(camera: Camera | RayCamera | Rig) -> Rig:
    """Return a rig of central cameras; a non-central one is approximated for distant points.

    Raises
    ------
    ValueError
        If it is neither a camera nor a rig.
    """
    if isinstance(camera, Rig):
        return replace(camera, cameras=tuple(map(_central, camera.cameras)))
    return Rig((_central(camera),), (Pose(),), ("camera",))


def at_one_point(rig: Rig) -> Rig:
    """Return the rig with all cameras at its origin, for a world without a scale."""
    return replace(rig, sensor_from_rig=tuple(Pose(pose.rotation) for pose in rig.sensor_from_rig))


def largest_baseline(rig: Rig) -> float:
    """Return the largest distance between two cameras of a rig, in its unit."""
    centers = np.array([pose.inverse().translation for pose in rig.sensor_from_rig])
    return float(np.linalg.norm(centers[:, None] - centers, axis=-1).max())


def has_baseline(rig: Rig) -> bool:
    """Return whether the cameras of a rig are apart."""
    return largest_baseline(rig) > 0


def _central(camera: Camera | RayCamera) -> Camera:
    """Return a central camera, of distant points for a non-central one."""
    if isinstance(camera, Camera):
        return camera
    # The type of the caller is not checked: a path in place of the camera is a likely mistake.
    if not isinstance(camera, RayCamera):  # pyright: ignore[reportUnnecessaryIsInstance]
        kind = type(camera).__name__
        raise ValueError(f"the camera is {kind}, not a camera or a rig: read its file (om.load, or om.load_rig)")
    return camera.central(float("inf"))[0]


def central_cameras(rig: Rig) -> list[Camera]:
    """Return the cameras of a rig, all of them central."""
    return [camera for camera in rig.cameras if isinstance(camera, Camera)]
