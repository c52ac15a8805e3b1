"""A mirror with its pose relative to the lens."""

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from omnisight.geometry.pose import Pose
from omnisight.models._parameter import parameter
from omnisight.models._parameterized import Parameterized
from omnisight.optics.mirrors import Mirror


@dataclass(frozen=True)
class PlacedMirror(Parameterized):
    """A mirror and its pose lens_from_mirror: x_lens = R x_mirror + t.

    t is the vertex in the lens frame. R = R_x(a) R_y(b) with a = tilt_x and b = tilt_y maps the mirror's axis to
    (sin b, -sin a cos b, cos a cos b). A mirror of revolution needs no third angle. `PlacedMirror(mirror, tz=D)` lies
    on the lens axis at the distance D. A mirror that faces away from the lens, such as the secondary mirror of a folded
    camera, has tilt_x = pi.
    """

    mirror: Mirror
    tilt_x: float = parameter("rotation of the mirror about the lens x axis", unit="rad", default=0.0)
    tilt_y: float = parameter("rotation of the mirror about its own y axis", unit="rad", default=0.0)
    tx: float = parameter("position of the vertex along x (right)", unit="m", default=0.0)
    ty: float = parameter("position of the vertex along y (down)", unit="m", default=0.0)
    tz: float = parameter("position of the vertex along the lens axis", unit="m", default=0.0)

    @classmethod
    def at(cls, mirror: Mirror, lens_from_mirror: Pose) -> Self:
        """Make it from a pose; the rotation about the mirror's own axis has no effect and is dropped."""
        x, y, z = lens_from_mirror.rotation[:, 2]
        return cls(
            mirror,
            float(np.arctan2(-y, z)),
            float(np.arcsin(np.clip(x, -1, 1))),
            *map(float, lens_from_mirror.translation),
        )

    @cached_property
    def lens_from_mirror(self) -> Pose:
        """The pose that maps mirror coordinates to lens coordinates."""
        (sa, ca), (sb, cb) = ((np.sin(t), np.cos(t)) for t in (self.tilt_x, self.tilt_y))
        rotation = np.array([[cb, 0, sb], [sa * sb, ca, -sa * cb], [-ca * sb, sa, ca * cb]])
        return Pose(rotation, np.array([self.tx, self.ty, self.tz]))
