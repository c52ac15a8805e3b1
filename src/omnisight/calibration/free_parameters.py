"""What a calibration estimates of what all its images share: parameters of the camera, the bend of the board."""

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
class FreeParameters:
    """What is estimated of what all images share.

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

        `square` pixels have one focal length: fx and fy move as one, or stay if one is fixed, and a stretch not at all.
        """
        names = model.param_names
        still = {*fixed, *(STRETCH if square else ())}
        moving = [(p.free and p.name not in still) or p.name in free for p in model.parameters]
        directions = np.eye(len(names))
        if square and {"fx", "fy"} <= set(names):
            x, y = names.index("fx"), names.index("fy")
            directions[y, x] = 1.0
            moving[x], moving[y] = moving[x] and moving[y], False
        return cls(directions[:, moving], warp)

    @classmethod
    def none(cls, model: CameraModel) -> Self:
        """Free nothing: only the poses move."""
        return cls(np.zeros((len(model.param_names), 0)))

    @property
    def count(self) -> int:
        """How many numbers are estimated."""
        return self.directions.shape[1] + 2 * self.warp


def squared(model: CameraModel, fixed: Sequence[str] = ()) -> CameraModel:
    """Give the camera with square pixels: its mean focal length or the one that is fixed, and no stretch."""
    values = model.to_dict()
    none: dict[str, float] = dict(zip(STRETCH, (1.0, 0.0, 0.0), strict=True))
    if "fx" in values and "fy" in values:
        known = [values[name] for name in ("fx", "fy") if name in fixed] or [values["fx"], values["fy"]]
        return model.with_values(none | dict.fromkeys(("fx", "fy"), sum(known) / len(known)))
    return model.with_values(none)
