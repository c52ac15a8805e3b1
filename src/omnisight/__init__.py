"""Calibrate any camera that sees more than a pinhole can, and turn its images into views."""

from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from omnisight.calibration.evaluation import evaluate_camera
    from omnisight.camera import Camera
    from omnisight.corners import read_corners
    from omnisight.formats import load, load_rig, save, save_rig
    from omnisight.geometry.pose import Pose
    from omnisight.geometry.rotation import look
    from omnisight.images import read_image, write_image
    from omnisight.models import CameraModel, model_class, model_names
    from omnisight.pipeline.central import Calibration, calibrate_camera
    from omnisight.pipeline.pictures import calibrate_pictures
    from omnisight.ray_camera import RayCamera
    from omnisight.rig import Rig
    from omnisight.targets import Checkerboard, Detection, detect_boards
    from omnisight.targets.observations import Observations
    from omnisight.views import (
        Remapper,
        cube_face,
        cylinder,
        fisheye,
        mercator,
        panini,
        perspective,
        planet,
        remap,
        sphere,
    )

# Where each name lives: imported when it is first used, so that a fresh process starts fast.
_HOME = {
    "calibration.evaluation": ("evaluate_camera",),
    "pipeline.central": ("Calibration", "calibrate_camera"),
    "pipeline.pictures": ("calibrate_pictures",),
    "targets.observations": ("Observations",),
    "camera": ("Camera",),
    "corners": ("read_corners",),
    "formats": ("load", "load_rig", "save", "save_rig"),
    "geometry.pose": ("Pose",),
    "geometry.rotation": ("look",),
    "images": ("read_image", "write_image"),
    "models": ("CameraModel", "model_class", "model_names"),
    "ray_camera": ("RayCamera",),
    "rig": ("Rig",),
    "targets": ("Checkerboard", "Detection", "detect_boards"),
    "views": (
        *("Remapper", "cube_face", "cylinder", "fisheye", "mercator"),
        *("panini", "perspective", "planet", "remap", "sphere"),
    ),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "Calibration",
    "Camera",
    "CameraModel",
    "Checkerboard",
    "Detection",
    "Observations",
    "Pose",
    "RayCamera",
    "Remapper",
    "Rig",
    "calibrate_camera",
    "calibrate_pictures",
    "cube_face",
    "cylinder",
    "detect_boards",
    "evaluate_camera",
    "fisheye",
    "load",
    "load_rig",
    "look",
    "mercator",
    "model_class",
    "model_names",
    "panini",
    "perspective",
    "planet",
    "read_corners",
    "read_image",
    "remap",
    "save",
    "save_rig",
    "sphere",
    "write_image",
]


def __getattr__(name: str) -> Any:
    """Import a public name at its first use."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'omnisight' has no attribute {name!r}")
    import importlib

    return getattr(importlib.import_module(f"omnisight.{_MODULE_OF[name]}"), name)
