"""A target whose points come with corners that another program detected."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from omnisight.display import Displayed


@dataclass(frozen=True, eq=False)
class PointTarget(Displayed):
    """Points of a board, or of several in one rigid body, that a file of corners lists.

    Attributes
    ----------
    points : (N, 3) array of float64
        Positions in `unit`; z = 0 on a single board.
    unit : str
        'm', or 'squares', the steps between neighbouring points, if no length is known.
    """

    kind: ClassVar[str] = "points"

    points: NDArray[np.float64]
    unit: str = "squares"

    def to_dict(self) -> dict[str, Any]:
        """Return what a camera file stores of it."""
        return {"target": self.kind, "points": len(self.points), "flat": not self.points[:, 2].any()}

    def __str__(self) -> str:
        return f"{len(self.points)} points" + (" of a rigid body" if self.points[:, 2].any() else "")
