"""Views: the one remap, and the cameras to remap to."""

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
