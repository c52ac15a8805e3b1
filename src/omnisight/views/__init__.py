"""Remapping of images from one camera to another, and cameras for common views."""

from omnisight.views.remapper import Remapper, remap
from omnisight.views.view_cameras import (
    cube_face,
    cylinder,
    fisheye,
    mercator,
    panini,
    perspective,
    planet,
    sphere,
)

__all__ = [
    "Remapper",
    "cube_face",
    "cylinder",
    "fisheye",
    "mercator",
    "panini",
    "perspective",
    "planet",
    "remap",
    "sphere",
]
