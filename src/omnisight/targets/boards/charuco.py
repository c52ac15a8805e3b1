"""The ChArUco board: a checkerboard with a marker in each white square, so that part of it is enough."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.boards._markers import cell_shapes, marker_cells, marker_count
from omnisight.targets.boards._protocol import CLEAR_SHARE, Board
from omnisight.targets.detection import Detection
from omnisight.targets.printing.drawing import Shape, rectangle

if TYPE_CHECKING:
    from omnisight.targets.grids.crossing import Crossings

SMALLEST = 2
LEAST_STEP = 5.0
"""Step in px below which a corner's window holds too few pixels to measure it well."""
LARGEST_WINDOW = 0.7
"""Longest step of a window, over the side of a square."""


@dataclass(frozen=True)
class Charuco(Board):
    """A checkerboard with markers in its white squares; found are the corners where four squares meet.

    `columns` and `rows` count inner corners, as those of a checkerboard do. OpenCV counts squares: the board of 9x6
    here is its `CharucoBoard((10, 7), square, marker, dictionary)`. Ids of corners and of markers are OpenCV's: row
    by row from the top left.

    Attributes
    ----------
    columns, rows : int
        Inner corners along the board's x and y.
    square, marker : float
        Sides of a square and of the marker within it, in metres.
    dictionary : str
        OpenCV's name of the markers' dictionary, such as DICT_5X5_100.
    legacy : bool
        Whether it is laid out as OpenCV before 4.6 did, `setLegacyPattern(True)`: with an even number of squares
        down, the square at the top left is white. With an odd number there is no difference.
    """

    kind: ClassVar[str] = "charuco"

    square: float = field(metadata={"length": True})
    marker: float = field(metadata={"length": True, "usual": (0.75, "square")})
    dictionary: str = "DICT_5X5_100"
    legacy: bool = False

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < SMALLEST:
            raise ValueError(
                f"a charuco needs {SMALLEST}x{SMALLEST} inner corners or more, got {self.columns}x{self.rows}"
            )
        if not 0 < self.marker < self.square < np.inf:
            raise ValueError(
                f"the marker of a charuco must be smaller than its square, and both positive; got marker"
                f" {self.marker * 1e3:g} mm, square {self.square * 1e3:g} mm"
            )
        needed, there_are = len(self.marker_squares), marker_count(self.dictionary)
        if needed > there_are:
            raise ValueError(f"a charuco of {self} needs {needed} markers; {self.dictionary} has {there_are}")

    @property
    def symmetric(self) -> bool:
        return False

    @property
    def unit(self) -> str:
        return "m"

    @property
    def points(self) -> NDArray[np.float64]:
        """Corner positions (N, 3) in metres: x along columns, y along rows, z = 0; x runs fastest."""
        y, x = np.mgrid[: self.rows, : self.columns]
        return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) * self.square

    @property
    def reach(self) -> float:
        """Length in metres as `Board.reach` says: the markers in the white squares end it."""
        return min(self.square, (self.square - self.marker) / 2 / CLEAR_SHARE)

    @property
    def bright(self) -> NDArray[np.bool_]:
        """Whether the square ahead of each point (N,), towards +x and +y, is a white one."""
        return np.array([not self._dark(i + 1, j + 1) for j in range(self.rows) for i in range(self.columns)])

    @property
    def extent(self) -> tuple[float, float, float, float]:
        return -self.square, -self.square, self.columns * self.square, self.rows * self.square

    @property
    def marker_squares(self) -> list[tuple[int, int]]:
        """White squares (column, row) in the order of their markers' ids; (0, 0) is the square at the top left."""
        return [(i, j) for j in range(self.rows + 1) for i in range(self.columns + 1) if not self._dark(i, j)]

    def drawing(self) -> list[Shape]:
        """Give its dark squares and the markers in the others."""
        side, gap = self.square, (self.square - self.marker) / 2
        shapes: list[Shape] = [
            rectangle((i - 1) * side, (j - 1) * side, side, side)
            for j in range(self.rows + 1)
            for i in range(self.columns + 1)
            if self._dark(i, j)
        ]
        for marker, (i, j) in enumerate(self.marker_squares):
            cells = marker_cells(self.dictionary, marker)
            shapes += cell_shapes(cells, (i - 1) * side + gap, (j - 1) * side + gap, self.marker)
        return shapes

    def detect(self, gray: NDArray[np.uint8]) -> list[Detection]:
        from omnisight.targets.markers import detect_charuco

        return detect_charuco(gray, self)

    def measure(
        self,
        gray: NDArray[Any],
        pixels: NDArray[np.float64],
        steps: NDArray[np.float64],
        bends: NDArray[np.float64],
    ) -> Crossings:
        """Measure corners as `Board.measure` says, where the board is small with a window that lets the markers in.

        Both markers at a corner are equally far from it and begin with black: they do not move it.
        """
        shortest = np.linalg.norm(steps, axis=2).min(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            longer = np.clip(LEAST_STEP / shortest, 1.0, max(1.0, LARGEST_WINDOW * self.square / self.reach))
        return super().measure(gray, pixels, steps * longer[:, None, None], bends * longer[:, None, None] ** 2)

    def _dark(self, column: int, row: int) -> bool:
        first_is_white = self.legacy and self.rows % 2 == 1
        return (column + row + first_is_white) % 2 == 0
