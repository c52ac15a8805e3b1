"""What a calibration estimates of what all its pictures share: parameters of the camera, the bend of the board."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.models import CameraModel

Array = NDArray[np.float64]

# What a stretch matrix (ocam) has beside a focal length: 1, 0 and 0 where pixels are square.
STRETCH = ("c", "d", "e")


@dataclass(frozen=True)
class Freedom:
    """What is estimated of what all pictures share.

    Attributes
    ----------
    directions
        (P, F) how the camera's P parameters move with each of the F numbers that are estimated of it.
    warp
        Whether the board's bend is estimated.
    """

    directions: Array
    warp: bool = False

    @classmethod
    def of(
        cls,
        model: CameraModel,
        *,
        fixed: Sequence[str] = (),
        free: Sequence[str] = (),
        square: bool = False,
        warp: bool = False,
    ) -> Self:
        """Free what a calibration of that model estimates, but `fixed`, and `free` beside; names it lacks are passed.

        `square` pixels have one focal length: fx and fy move as one, and a stretch not at all.
        """
        names = model.param_names
        still = {*fixed, *(STRETCH if square else ())}
        moving = [(p.free and p.name not in still) or p.name in free for p in model.parameters]
        directions = np.eye(len(names))
        if square and {"fx", "fy"} <= set(names) and moving[names.index("fx")] and moving[names.index("fy")]:
            directions[names.index("fy"), names.index("fx")] = 1.0
            moving[names.index("fy")] = False
        return cls(directions[:, moving], warp)

    @classmethod
    def none(cls, model: CameraModel) -> Self:
        """Free nothing: only the poses move."""
        return cls(np.zeros((len(model.param_names), 0)))

    @property
    def count(self) -> int:
        """How many numbers are estimated."""
        return self.directions.shape[1] + 2 * self.warp


def squared(model: CameraModel) -> CameraModel:
    """Give the camera with square pixels: its mean focal length, and no stretch."""
    values = model.to_dict()
    if "fx" in values and "fy" in values:
        values["fx"] = values["fy"] = (values["fx"] + values["fy"]) / 2
    stretch = dict(zip(STRETCH, (1.0, 0.0, 0.0), strict=True))
    values |= {name: value for name, value in stretch.items() if name in values}
    return model.with_params([values[name] for name in model.param_names])
