"""The asymmetric circle grid: discs in rows, every second row moved by half a step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.boards._protocol import Board
from omnisight.targets.detection import Detection
from omnisight.targets.printing.drawing import Disc, Shape

if TYPE_CHECKING:
    from omnisight.targets.grids.crossing import Crossings

SMALLEST = 2, 3

CLEAR = 0.7
"""Distance from a disc's middle, over the spacing, that is free of others: half of that to the next disc's middle."""


@dataclass(frozen=True)
class CircleGrid(Board):
    """A grid of black discs as OpenCV's `CALIB_CB_ASYMMETRIC_GRID` has it; found are their middles.

    Disc `row * columns + column` lies at x = (2 column + row mod 2) spacing, y = row spacing: 4x11 is OpenCV's
    `Size(4, 11)`. A disc's middle is not where the middle of its image is, more so in a wide lens and near its rim,
    so a board with corners measures better.

    Attributes
    ----------
    columns, rows : int
        Discs in a row, and rows.
    spacing : float
        Distance in metres from a row to the next; discs of one row are twice as far apart.
    diameter : float or None
        Of a disc, in metres; None where it is not known: it is needed to draw the board, not to find it.
    """

    kind: ClassVar[str] = "circles"

    spacing: float = field(metadata={"length": True})
    diameter: float | None = field(default=None, metadata={"length": True, "usual": (1.0, "spacing")})

    def __post_init__(self) -> None:
        if self.columns < SMALLEST[0] or self.rows < SMALLEST[1]:
            raise ValueError(
                f"a grid of circles needs {SMALLEST[0]} columns and {SMALLEST[1]} rows or more, got {self}"
            )
        if not 0 < self.spacing < np.inf:
            raise ValueError(f"a grid of circles needs a positive spacing in metres, got {self.spacing}")
        nearest = self.spacing * 2**0.5
        if self.diameter is not None and not 0 < self.diameter < nearest:
            raise ValueError(
                f"circles of {self.diameter * 1e3:g} mm that are {nearest * 1e3:.4g} mm apart: the diameter must be"
                " positive, and less than that"
            )

    @property
    def symmetric(self) -> bool:
        """Whether it looks the same upside-down: with an even number of rows."""
        return self.rows % 2 == 0

    @property
    def unit(self) -> str:
        return "m"

    @property
    def quiet(self) -> float:
        return self.spacing

    @property
    def points(self) -> NDArray[np.float64]:
        """Middles of the discs (N, 3) in metres: x runs fastest, z = 0."""
        row, column = np.mgrid[: self.rows, : self.columns]
        x, y = 2 * column + row % 2, row
        return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) * self.spacing

    @property
    def reach(self) -> float:
        return self.spacing

    def offset(self, project: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> NDArray[np.float64]:
        from omnisight.targets.circles import circle_shift

        if self.diameter is None:
            return super().offset(project)
        return circle_shift(project, self.points, self.diameter / 2)

    @property
    def extent(self) -> tuple[float, float, float, float]:
        radius = self._radius()
        right, bottom = (2 * self.columns - 1) * self.spacing, (self.rows - 1) * self.spacing
        return -radius, -radius, right + radius, bottom + radius

    def drawing(self) -> list[Shape]:
        """Give its discs."""
        radius = self._radius()
        return [Disc((x, y), radius) for x, y, _ in self.points.tolist()]

    def detect(self, gray: NDArray[np.uint8]) -> list[Detection]:
        from omnisight.targets.circles import detect_circles

        return detect_circles(gray, self)

    def measure(
        self,
        gray: NDArray[Any],
        pixels: NDArray[np.float64],
        steps: NDArray[np.float64],
        bends: NDArray[np.float64],
    ) -> Crossings:
        """Measure the middles of the discs' images as `Board.measure` says; `circle_shift` leads to the discs'."""
        from omnisight.targets.discs import fit_discs

        radius = (self.diameter or self.spacing) / 2
        matrices = np.swapaxes(steps, 1, 2) * (radius / self.reach)
        return fit_discs(gray, pixels, matrices, CLEAR * self.spacing / radius)

    def _radius(self) -> float:
        if self.diameter is None:
            raise ValueError(f"the diameter of the circles of the {self} board is not known: give it, such as 20mm")
        return self.diameter / 2
