"""The symmetric circle grid: discs in straight rows and columns."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.boards._protocol import grid_points
from omnisight.targets.boards.circles import CircleGrid


@dataclass(frozen=True)
class SymmetricCircles(CircleGrid):
    """A grid of black discs like OpenCV's `CALIB_CB_SYMMETRIC_GRID`; its points are their centres.

    Disc `row * columns + column` lies at x = column spacing, y = row spacing: 7x6 is OpenCV's `Size(7, 6)`. It looks
    the same upside-down, and in a mirror, so its origin is ambiguous and a mirror image cannot be recognized.

    Attributes
    ----------
    columns, rows : int
        Discs in a row, and rows.
    spacing : float
        Distance in metres from a disc to the next, along rows and columns.
    diameter : float or None
        Of a disc, in metres; None if unknown.
    """

    kind: ClassVar[str] = "symmetric_circles"
    is_staggered: ClassVar[bool] = False

    # The default is that of OpenCV's gen_pattern.py: the spacing over the radius is 5.
    diameter: float | None = field(default=None, metadata={"length": True, "default": (0.4, "spacing")})

    @property
    def pitch(self) -> float:
        return self.spacing

    @property
    def is_symmetric(self) -> bool:
        """Whether it looks the same upside-down: always."""
        return True

    @property
    def points(self) -> NDArray[np.float64]:
        """Centres of the discs (N, 3) in metres: x runs fastest, z = 0."""
        return grid_points(self.columns, self.rows, self.spacing)
