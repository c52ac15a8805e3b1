"""Cameras and rigs that a user specifies for a plot: objects or calibration files."""

from os import PathLike
from pathlib import Path

from omnisight.camera import Camera
from omnisight.formats import load, load_all, load_rig
from omnisight.ray_camera import RayCamera
from omnisight.rig import Rig

File = str | PathLike[str]
CameraSource = Camera | RayCamera | File


def central_camera(source: CameraSource) -> Camera:
    """Return a camera, or that of a file; of a non-central one its limit for a distant scene."""
    camera = source if isinstance(source, Camera | RayCamera) else load(Path(source))
    return camera.central_limit if isinstance(camera, RayCamera) else camera


def camera_or_rig(path: File) -> Camera | RayCamera | Rig:
    """Read the camera of a file, or its rig if it holds several cameras."""
    cameras = load_all(Path(path))
    return load_rig(Path(path)) if len(cameras) > 1 else next(iter(cameras.values()))
