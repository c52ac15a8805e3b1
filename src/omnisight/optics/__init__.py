"""Mirrors, catadioptric cameras, viewpoints and caustics."""

from omnisight.optics.catadioptric import Catadioptric
from omnisight.optics.mirrors import Mirror, mirror_class, mirror_names
from omnisight.optics.placed_mirror import PlacedMirror
from omnisight.optics.ray_model import RayModel
from omnisight.optics.reflection import reflect
from omnisight.optics.telecentric import Telecentric

__all__ = [
    "Catadioptric",
    "Mirror",
    "PlacedMirror",
    "RayModel",
    "Telecentric",
    "mirror_class",
    "mirror_names",
    "reflect",
]
