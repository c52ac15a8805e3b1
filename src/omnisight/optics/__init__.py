"""Mirrors, and cameras that look into them."""

from omnisight.optics.catadioptric import Catadioptric
from omnisight.optics.mirrors import Mirror, mirror_class, mirror_names
from omnisight.optics.orthographic import Orthographic
from omnisight.optics.placed import Placed
from omnisight.optics.ray_model import RayModel
from omnisight.optics.reflection import reflect

__all__ = ["Catadioptric", "Mirror", "Orthographic", "Placed", "RayModel", "mirror_class", "mirror_names", "reflect"]
