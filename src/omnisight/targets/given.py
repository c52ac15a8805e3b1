"""A target whose points something else has found: told, not looked for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class PointTarget:
    """Points that came with corners that something else found: of a board, or of several in one rigid body.

    Attributes
    ----------
    points : (N, 3) array of float64
        Where they are, in `unit`; of a single board z = 0.
    unit : str
        'm', or 'squares', the steps between neighbouring points, where no length was told.
    """

    kind: ClassVar[str] = "points"

    points: NDArray[np.float64]
    unit: str = "squares"

    def to_dict(self) -> dict[str, Any]:
        """Give what a camera's file says of it."""
        return {"target": self.kind, "points": len(self.points), "flat": not self.points[:, 2].any()}

    def __str__(self) -> str:
        return f"{len(self.points)} points" + (" of a solid body" if self.points[:, 2].any() else "")
