"""What a detector found in one picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Detection:
    """Board points seen in one picture; part of a board is a detection too.

    Attributes
    ----------
    ids : (N,) array of int
        Which rows of `Board.points`, ascending.
    pixels : (N, 2) array of float64
        Where they were seen: (u, v), integers at pixel centres, the top-left pixel is (0, 0).
    """

    ids: NDArray[np.int64]
    pixels: NDArray[np.float64]

    def __post_init__(self) -> None:
        if self.ids.ndim != 1 or self.pixels.shape != (len(self.ids), 2):
            raise ValueError(
                f"expected ids (N,) and pixels (N, 2), got shapes {self.ids.shape} and {self.pixels.shape}"
            )

    def __len__(self) -> int:
        return len(self.ids)
