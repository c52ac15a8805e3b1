"""The free parameters of a calibration that all views share: camera parameters and board warp."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.display import Displayed
from omnisight.models import CameraModel, Projector

Array = NDArray[np.float64]

# Stretch matrix of the Scaramuzza model [c d; e 1], and its value for square pixels.
SQUARE_STRETCH = {"c": 1.0, "d": 0.0, "e": 0.0}


@dataclass(frozen=True)
class FreeParameters(Displayed):
    """What a calibration estimates of the parameters that all views share.

    Attributes
    ----------
    directions
        (P, F) derivative of the camera's P parameters by the F estimated numbers.
    warp
        Whether the board warp is estimated.
    bend_sigma
        Standard deviation of the prior on the bends of the board, in its unit; 0 if none are estimated.
    """

    directions: Array
    warp: bool = False
    bend_sigma: float = 0.0

    @classmethod
    def of(
        cls,
        model: Projector,
        *,
        fixed: Sequence[str] = (),
        free: Sequence[str] = (),
        square: bool = False,
        warp: bool = False,
    ) -> Self:
        """Return the default free parameters of a model, without those in `fixed` and with those in `free`.

        Names that the model lacks are ignored. With `square` pixels, fx and fy move together, or not at all if one is
        fixed, and a stretch matrix is constant.
        """
        names = model.param_names
        constant = {*fixed, *(SQUARE_STRETCH if square else ())}
        moves = [(p.free and p.name not in constant) or p.name in free for p in model.parameters]
        directions = np.eye(len(names))
        if square and {"fx", "fy"} <= set(names):
            x, y = names.index("fx"), names.index("fy")
            directions[y, x] = 1.0
            moves[x], moves[y] = moves[x] and moves[y], False
        return cls(directions[:, moves], warp)

    @classmethod
    def none(cls, model: Projector) -> Self:
        """Return no free parameters: only the poses are estimated."""
        return cls(np.zeros((len(model.param_names), 0)))

    @property
    def per_view(self) -> int:
        """Number of values that are estimated of each view: its pose, and its bend."""
        return 9 if self.bend_sigma else 6

    def without_camera(self) -> Self:
        """Return only what is estimated of each view."""
        return replace(self, directions=self.directions[:, :0], warp=False)

    @property
    def count(self) -> int:
        """Number of estimated values that all views share."""
        return self.directions.shape[1] + 2 * self.warp


def with_square_pixels(model: CameraModel, fixed: Sequence[str] = ()) -> CameraModel:
    """Return the camera with one focal length, the fixed one or the mean, and no stretch."""
    values, changes = model.to_dict(), dict(SQUARE_STRETCH)
    if "fx" in values and "fy" in values:
        known = [values[name] for name in ("fx", "fy") if name in fixed] or [values["fx"], values["fy"]]
        changes |= dict.fromkeys(("fx", "fy"), sum(known) / len(known))
    return model.with_values(changes)
