"""A mirror where it stands before the lens."""

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from omnisight.geometry.pose import Pose
from omnisight.models._parameter import parameter
from omnisight.models._parametric import Parametric
from omnisight.optics.mirrors import Mirror


@dataclass(frozen=True)
class Placed(Parametric):
    """A mirror and its pose lens_from_mirror: x_lens = R x_mirror + t.

    t is where the lens sees the vertex; R = R_x(tilt_x) R_y(tilt_y) turns the axis, which is (sin b, -sin a cos b,
    cos a cos b) to the lens, and a mirror of revolution has no other pose than these. On the axis of the lens at the
    distance D: `Placed(mirror, tz=D)`. One that looks back at the lens's side has tilt_x = pi.
    """

    mirror: Mirror
    tilt_x: float = parameter("turn of the mirror's axis about x", unit="rad", default=0.0)
    tilt_y: float = parameter("turn of the mirror's axis about its y", unit="rad", default=0.0)
    tx: float = parameter("where the vertex is, to the right", unit="m", default=0.0)
    ty: float = parameter("where the vertex is, down", unit="m", default=0.0)
    tz: float = parameter("where the vertex is, along the lens's axis", unit="m", default=0.0)

    @classmethod
    def at(cls, mirror: Mirror, lens_from_mirror: Pose) -> Self:
        """Place a mirror by its pose; a turn about the mirror's own axis makes no difference, and is dropped."""
        x, y, z = lens_from_mirror.rotation[:, 2]
        return cls(
            mirror,
            float(np.arctan2(-y, z)),
            float(np.arcsin(np.clip(x, -1, 1))),
            *map(float, lens_from_mirror.translation),
        )

    @cached_property
    def lens_from_mirror(self) -> Pose:
        """The pose."""
        (sa, ca), (sb, cb) = ((np.sin(t), np.cos(t)) for t in (self.tilt_x, self.tilt_y))
        rotation = np.array([[cb, 0, sb], [sa * sb, ca, -sa * cb], [-ca * sb, sa, ca * cb]])
        return Pose(rotation, np.array([self.tx, self.ty, self.tz]))
