"""What a detector found in one image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from omnisight.targets.boards import Board


@dataclass(frozen=True, eq=False)
class Detection:
    """Board points seen in one image; part of a board is a detection too.

    Attributes
    ----------
    ids : (N,) array of int
        Which rows of `Board.points`, ascending.
    pixels : (N, 2) array of float64
        Where they were seen: (u, v), integers at pixel centres, the top-left pixel is (0, 0).
    covariance : (N, 2, 2) array of float64
        Of `pixels`, in px^2.
    located : bool
        Whether the place on the board is sure. If not, `ids` are those of one of several places that look the same: the
        steps between the points are right, which is all that a camera is calibrated from, but the origin may not be.
    board : Board or None
        The board whose points `ids` number; None where it was not told.
    note : str
        What the user should know, such as that the print is not quite the board that was asked for; may be empty.
    """

    ids: NDArray[np.int64]
    pixels: NDArray[np.float64]
    covariance: NDArray[np.float64]
    located: bool = True
    note: str = ""
    board: Board | None = None

    def __post_init__(self) -> None:
        count = len(self.ids)
        if self.ids.ndim != 1 or self.pixels.shape != (count, 2) or self.covariance.shape != (count, 2, 2):
            raise ValueError(
                f"expected ids (N,), pixels (N, 2) and covariance (N, 2, 2), got shapes {self.ids.shape},"
                f" {self.pixels.shape} and {self.covariance.shape}"
            )

    def __len__(self) -> int:
        return len(self.ids)
