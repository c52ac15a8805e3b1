"""The boards of a calibration as flat arrays."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BoardViews:
    """Corners of boards seen in pictures, all pictures in one array.

    Attributes
    ----------
    points
        (N, 3) corners in the frame of their board.
    pixels
        (N, 2) where they are seen.
    groups
        One slice of the rows per picture.
    names
        One name per picture.
    """

    points: Array
    pixels: Array
    groups: tuple[slice, ...]
    names: tuple[str, ...]

    @classmethod
    def of(cls, views: Sequence[tuple[ArrayLike, ArrayLike]], names: Sequence[str] | None = None) -> "BoardViews":
        """Join pictures, each (points (n, 3), pixels (n, 2)).

        Raises
        ------
        ValueError
            If a picture's arrays do not fit together, or are not finite.
        """
        names = tuple(names) if names is not None else tuple(f"view {i}" for i in range(len(views)))
        points, pixels, groups, start = [np.zeros((0, 3))], [np.zeros((0, 2))], list[slice](), 0
        for name, (view_points, view_pixels) in zip(names, views, strict=True):
            x, p = np.asarray(view_points, float), np.asarray(view_pixels, float)
            if x.ndim != 2 or x.shape[1] != 3 or p.shape != (len(x), 2):
                raise ValueError(f"{name}: needs points (n, 3) and pixels (n, 2), got {x.shape} and {p.shape}")
            if not (np.isfinite(x).all() and np.isfinite(p).all()):
                raise ValueError(f"{name}: a corner is not a finite number")
            points.append(x)
            pixels.append(p)
            groups.append(slice(start, start + len(x)))
            start += len(x)
        return cls(np.concatenate(points), np.concatenate(pixels), tuple(groups), names)

    def __len__(self) -> int:
        """Give the number of pictures."""
        return len(self.groups)

    @property
    def view_of_row(self) -> NDArray[np.intp]:
        """(N,) the picture of each corner."""
        return np.repeat(np.arange(len(self)), [g.stop - g.start for g in self.groups])

    def subset(self, views: Sequence[int] | NDArray[np.intp]) -> "BoardViews":
        """Give some of the pictures."""
        chosen = [(self.points[self.groups[i]], self.pixels[self.groups[i]]) for i in views]
        return BoardViews.of(chosen, [self.names[i] for i in views])
