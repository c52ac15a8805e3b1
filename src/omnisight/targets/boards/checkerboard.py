"""The checkerboard: its points are the inner corners, where four squares meet."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.boards._protocol import Board, grid_points, parse_pattern, parse_squares
from omnisight.targets.length import parse_length
from omnisight.targets.printing.drawing import Shape, rectangle

MIN_CORNERS = 3


@dataclass(frozen=True)
class Checkerboard(Board):
    """A checkerboard, by its inner corners: the points where four squares meet.

    Attributes
    ----------
    columns, rows : int
        Inner corners along the board's x and y; a board of 10 x 7 squares has 9 x 6.
    square : float or None
        Side of a square in metres; None if unknown.
    """

    kind: ClassVar[str] = "checkerboard"
    detector: ClassVar[str] = "checkerboard"

    columns: int
    rows: int
    square: float | None = field(default=None, metadata={"length": True})

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < MIN_CORNERS:
            raise ValueError(
                f"a board needs {MIN_CORNERS}x{MIN_CORNERS} inner corners or more, got {self.columns}x{self.rows}"
                f" ({squares_text(self.columns, self.rows)})"
            )
        if self.square is not None and not 0 < self.square < np.inf:
            raise ValueError(f"a square needs a positive side in metres, got {self.square}")

    @classmethod
    def parse(cls, pattern: str, square: str | None = None) -> "Checkerboard":
        """Build a board from text.

        Parameters
        ----------
        pattern : str
            Inner corners, columns then rows: `8x6`, `8,6`, `8 x 6`.
        square : str, optional
            Side of a square with its unit: `32.5mm`, `3.25 cm`, `0.0325m`, `1in`.

        Raises
        ------
        ValueError
            If either cannot be read, or the unit is missing.
        """
        size = parse_pattern(pattern)
        return cls(size["columns"], size["rows"], None if square is None else parse_length(square))

    @classmethod
    def of_squares(cls, squares: str, square: str | None = None) -> "Checkerboard":
        """Build a board from its number of squares, columns then rows, such as `10x7`; see `parse`."""
        size = parse_squares(squares)
        return cls(size["columns"], size["rows"], None if square is None else parse_length(square))

    @property
    def is_symmetric(self) -> bool:
        """Whether the board looks the same upside-down: either of two corners may then be its origin."""
        return (self.columns + self.rows) % 2 == 0

    @property
    def unit(self) -> str:
        return "squares" if self.square is None else "m"

    @property
    def points(self) -> NDArray[np.float64]:
        """Corner positions (N, 3) in `unit`: x along columns, y along rows, z = 0; x runs fastest."""
        return grid_points(self.columns, self.rows, self.window_step)

    @property
    def window_step(self) -> float:
        return 1.0 if self.square is None else self.square

    @property
    def bright_ahead(self) -> NDArray[np.bool_]:
        j, i = np.divmod(np.arange(self.size), self.columns)
        return (i + j) % 2 == 1

    @property
    def extent(self) -> tuple[float, float, float, float]:
        side = self._known_side()
        return -side, -side, self.columns * side, self.rows * side

    def drawing(self) -> list[Shape]:
        """Return the dark squares; the one between the first corners of the first two rows is dark."""
        side = self._known_side()
        return [
            rectangle((i - 1) * side, (j - 1) * side, side, side)
            for j in range(self.rows + 1)
            for i in range(self.columns + 1)
            if (i + j) % 2 == 0
        ]

    def _known_side(self) -> float:
        if self.square is None:
            raise ValueError(f"the side of a square of the {self} board is unknown: specify it, such as 30mm")
        return self.square


def squares_text(columns: int, rows: int) -> str:
    """Format the number of squares of a board by its inner corners: 10x7 squares for 9 and 6."""
    return f"{columns + 1}x{rows + 1} squares"
