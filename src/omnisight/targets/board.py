"""The checkerboard that is held in front of the camera."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_METRES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}
_SMALLEST = 3


@dataclass(frozen=True)
class Board:
    """A checkerboard, by its inner corners: the points where four squares meet.

    Attributes
    ----------
    columns, rows : int
        Inner corners along the board's x and y; a board of 10 x 7 squares has 9 x 6.
    square : float or None
        Side of a square in metres; None where it is not known.
    unit : str
        Unit of `points`: 'm' with a square size, 'squares' without.
    """

    columns: int
    rows: int
    square: float | None = None
    unit: str = "squares"

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < _SMALLEST:
            raise ValueError(
                f"a board needs {_SMALLEST}x{_SMALLEST} inner corners or more, got {self.columns}x{self.rows}"
            )
        if self.square is not None and not 0 < self.square < np.inf:
            raise ValueError(f"a square needs a positive side in metres, got {self.square}")
        object.__setattr__(self, "unit", "squares" if self.square is None else "m")

    @classmethod
    def parse(cls, pattern: str, square: str | None = None) -> Board:
        """Read a board as a user writes it.

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
        match = re.fullmatch(r"\s*([0-9]{1,4})\s*[xX×,]\s*([0-9]{1,4})\s*", pattern)
        if match is None:
            raise ValueError(f"cannot read the pattern {pattern!r}: give inner corners as COLUMNSxROWS, such as 8x6")
        side = None if square is None else parse_length(square)
        return cls(int(match[1]), int(match[2]), side)

    @property
    def size(self) -> int:
        """Number of inner corners."""
        return self.columns * self.rows

    @property
    def symmetric(self) -> bool:
        """Whether the board looks the same upside-down: its origin may be either of two corners."""
        return (self.columns + self.rows) % 2 == 0

    @property
    def points(self) -> NDArray[np.float64]:
        """Corner positions (N, 3) in `unit`: x along columns, y along rows, z = 0; x runs fastest."""
        y, x = np.mgrid[: self.rows, : self.columns]
        points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
        return points * (1.0 if self.square is None else self.square)

    def __str__(self) -> str:
        return f"{self.columns}x{self.rows}"


def parse_length(text: str) -> float:
    """Read a length with its unit, `32.5mm`, in metres; ValueError if it has none or is not positive."""
    match = re.fullmatch(r"\s*([0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?)\s*([a-zA-Z\"]*)\s*", text)
    units = ", ".join(_METRES)
    if match is None:
        raise ValueError(f"cannot read the length {text!r}: give a number with its unit ({units}), such as 32.5mm")
    number, unit = match[1], match[2].lower()
    if not unit:
        raise ValueError(
            f"the length {text.strip()!r} has no unit: write {number}mm if millimetres are meant ({units})"
        )
    if unit not in _METRES:
        raise ValueError(f"the length {text.strip()!r} has an unknown unit {match[2]!r}: use one of {units}")
    metres = float(number) * _METRES[unit]
    if not 0 < metres < np.inf:
        raise ValueError(f"the length {text.strip()!r} must be positive")
    return metres
