"""Rigs of central cameras that see from one point."""

from dataclasses import replace

from omnisight.camera import Camera
from omnisight.geometry.pose import Pose
from omnisight.ray_camera import RayCamera
from omnisight.rig import Rig


def central_rig(camera: Camera | RayCamera | Rig) -> Rig:
    """Return a rig whose cameras see from one point.

    Without a scale of the world, the distances of the cameras of a rig, and of the rays of a non-central camera, are of
    no use: they are small against those of the points.
    """
    if isinstance(camera, Rig):
        poses = tuple(Pose(pose.rotation) for pose in camera.sensor_from_rig)
        return replace(camera, cameras=tuple(map(_central, camera.cameras)), sensor_from_rig=poses)
    return Rig((_central(camera),), (Pose(),), ("camera",))


def _central(camera: Camera | RayCamera) -> Camera:
    """Return a central camera, of distant points for a non-central one."""
    return camera if isinstance(camera, Camera) else camera.central(float("inf"))[0]


def central_cameras(rig: Rig) -> list[Camera]:
    """Return the cameras of a rig, all of them central."""
    return [camera for camera in rig.cameras if isinstance(camera, Camera)]
