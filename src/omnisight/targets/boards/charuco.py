"""The ChArUco board: a checkerboard with a marker in each white square; any part of it is enough."""

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.boards._aruco import cell_shapes, marker_cells, marker_count
from omnisight.targets.boards._marker_board import BoardVariant, MarkerBoard, MarkerLayout
from omnisight.targets.boards._protocol import MAX_WINDOW_SHARE, grid_points
from omnisight.targets.printing.drawing import Shape, rectangle

MIN_CORNERS = 2
# Longest step of a window over the side of a square, in images where `window_step` is too small. Both markers at a
# corner are equally far from it and have black borders: they do not move it.
MAX_WINDOW_STEP_SQUARES = 0.7


@dataclass(frozen=True)
class Charuco(MarkerBoard):
    """A checkerboard with markers in its white squares; its points are the inner corners.

    `columns` and `rows` count inner corners, as for a checkerboard. OpenCV counts squares: the board of 9x6 here is
    its `CharucoBoard((10, 7), square, marker, dictionary)`. Ids of corners and of markers are OpenCV's: row by row
    from the top left.

    Attributes
    ----------
    columns, rows : int
        Inner corners along the board's x and y.
    square, marker : float
        Sides of a square and of the marker within it, in metres.
    dictionary : str
        OpenCV's name of the markers' dictionary, such as DICT_5X5_100.
    legacy : bool
        Layout of OpenCV before 4.6, `setLegacyPattern(True)`: with an even number of squares down, the square at the
        top left is white. With an odd number there is no difference.
    """

    kind: ClassVar[str] = "charuco"

    square: float = field(metadata={"length": True})
    marker: float = field(metadata={"length": True, "default": (0.75, "square")})
    dictionary: str = "DICT_5X5_100"
    legacy: bool = False

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < MIN_CORNERS:
            raise ValueError(
                f"a charuco needs {MIN_CORNERS}x{MIN_CORNERS} inner corners or more, got {self.columns}x{self.rows}"
            )
        if not 0 < self.marker < self.square < np.inf:
            raise ValueError(
                f"the marker of a charuco must be smaller than its square, and both positive; got marker"
                f" {self.marker * 1e3:g} mm, square {self.square * 1e3:g} mm"
            )
        needed, available = self.first_marker + len(self.marker_squares), marker_count(self.dictionary)
        if needed > available:
            first = f" from number {self.first_marker}" if self.first_marker else ""
            raise ValueError(f"a charuco of {self}{first} needs {needed} markers; {self.dictionary} has {available}")

    @property
    def points(self) -> NDArray[np.float64]:
        """Corner positions (N, 3) in metres: x along columns, y along rows, z = 0; x runs fastest."""
        return grid_points(self.columns, self.rows, self.square)

    @property
    def layout(self) -> MarkerLayout:
        side, half = self.square, self.marker / 2
        centres = (np.array(self.marker_squares, np.float64) - 0.5) * side
        corners = centres[:, None] + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        return MarkerLayout(self.points[:, :2], corners, side, side, side, self.dictionary, 1, self.first_marker)

    @property
    def window_step(self) -> float:
        """Step of the window, in metres: the markers in the white squares limit it."""
        return min(self.square, (self.square - self.marker) / 2 / MAX_WINDOW_SHARE)

    @property
    def max_window_step(self) -> float:
        return max(self.window_step, MAX_WINDOW_STEP_SQUARES * self.square)

    @property
    def bright_ahead(self) -> NDArray[np.bool_]:
        return np.array([not self._is_dark(i + 1, j + 1) for j in range(self.rows) for i in range(self.columns)])

    @property
    def extent(self) -> tuple[float, float, float, float]:
        return -self.square, -self.square, self.columns * self.square, self.rows * self.square

    @property
    def marker_squares(self) -> list[tuple[int, int]]:
        """White squares (column, row) in the order of their markers' ids; (0, 0) is the square at the top left."""
        return [(i, j) for j in range(self.rows + 1) for i in range(self.columns + 1) if not self._is_dark(i, j)]

    def drawing(self) -> list[Shape]:
        """Return the dark squares, and the markers in the others."""
        side, gap = self.square, (self.square - self.marker) / 2
        shapes: list[Shape] = [
            rectangle((i - 1) * side, (j - 1) * side, side, side)
            for j in range(self.rows + 1)
            for i in range(self.columns + 1)
            if self._is_dark(i, j)
        ]
        for marker, (i, j) in enumerate(self.marker_squares):
            cells = marker_cells(self.dictionary, self.first_marker + marker)
            shapes += cell_shapes(cells, (i - 1) * side + gap, (j - 1) * side + gap, self.marker)
        return shapes

    def variants(self) -> list[BoardVariant]:
        """Return the board, then those of the other layout and with columns and rows swapped."""
        same = np.arange(self.size)
        swapped = replace(self, columns=self.rows, rows=self.columns)
        # A quarter turn maps the swapped board onto this one: x' and y' of the one are y and -x of the other.
        row, column = np.divmod(same, swapped.columns)
        rotated = column * self.columns + self.columns - 1 - row
        variants = super().variants()
        for other, ids, swap in ((self, same, ""), (swapped, rotated, f"columns and rows swapped ({swapped})")):
            for legacy in (self.legacy, not self.legacy):
                is_self = other == self and legacy == self.legacy
                same_layout = legacy != self.legacy and other.rows % 2 == 0
                if is_self or same_layout or (other is not self and self.columns == self.rows):
                    continue
                layout = f"the layout of OpenCV {'before' if legacy else 'since'} 4.6 (legacy: {str(legacy).lower()})"
                differences = filter(None, (swap, layout if legacy != self.legacy else ""))
                variants.append(
                    BoardVariant(replace(other, legacy=legacy), ids, f"the print has {', and '.join(differences)}")
                )
        return variants

    def _is_dark(self, column: int, row: int) -> bool:
        first_is_white = self.legacy and self.rows % 2 == 1
        return (column + row + first_is_white) % 2 == 0
