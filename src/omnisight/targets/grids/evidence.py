"""What the image says about a lattice: where its corners are, and whether they are corners at all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .crossing import fit_crossings
from .lattice import Lattice, bends, orientation, predictions, spacing, steps
from .sampling import bilinear

Array = NDArray[np.float64]

_TOLERANCE = 0.3
"""How far a corner may be from where its neighbours put it, over the distance to the nearest of them."""

_ROUNDS = 12
"""How many lines a lattice may grow on each side."""

_REACHES = (0.18, 0.28)
"""Where the squares around a corner are looked at, over their diagonals."""

FAINT = 0.2
"""Contrast across a corner below this part of the board's median is none."""

EXPLAINED = 0.6
"""Share of a window's variation that two crossing edges must explain."""

_LEAST_IN_LINE = 2
"""Corners that an outer line needs in any case."""

_NIGHT = 0.3
"""Brightness over the board's contrast below which a place is dark outside of what the lens shows."""

_FEWEST = 6
"""Corners below which there is nothing to grow."""

_LEAST_FILLED = 0.5
"""Part of an outer line's corners that must be there for the line to count."""


@dataclass
class Measured:
    """A lattice with what was measured at its corners; NaN where a corner is missing.

    Attributes
    ----------
    pixels : (R, C, 2) array
    covariance : (R, C, 2, 2) array
    amplitude, blur, explained : (R, C) array
        As in `Crossings`.
    """

    pixels: Lattice
    covariance: Array
    amplitude: Array
    blur: Array
    explained: Array

    @classmethod
    def empty(cls, shape: tuple[int, ...]) -> Measured:
        """Give a lattice of `shape` with nothing measured yet."""
        return cls(*(np.full((*shape[:2], *more), np.nan) for more in ((2,), (2, 2), (), (), ())))

    def measure(
        self, gray: NDArray[np.uint8], lattice: Lattice, where: NDArray[np.bool_], *, rough: bool = False
    ) -> None:
        """Measure the corners (R, C) that `where` says, with the steps and bends of `lattice`."""
        i, j = np.nonzero(where & np.isfinite(lattice[..., 0]))
        along = np.stack(steps(lattice), axis=-2)[i, j]
        bent = np.nan_to_num(np.stack(bends(lattice), axis=-2)[i, j])
        for own, found in zip(
            self._arrays(), fit_crossings(gray, lattice[i, j], along, bent, rough=rough), strict=True
        ):
            own[i, j] = found

    def padded(self) -> Measured:
        """Give it with one line more on each side, of missing corners."""
        wide = Measured.empty((self.pixels.shape[0] + 2, self.pixels.shape[1] + 2))
        for own, other in zip(wide._arrays(), self._arrays(), strict=True):
            own[1:-1, 1:-1] = other
        return wide

    def part(self, rows: slice, columns: slice) -> Measured:
        """Cut out a part."""
        return Measured(*(array[rows, columns] for array in self._arrays()))

    def mirrored(self) -> Measured:
        """Give it with its columns in the opposite order, which puts another square ahead of each corner."""
        other = self.part(slice(None), slice(None, None, -1))
        other.amplitude = -other.amplitude
        return other

    def check(self, gray: NDArray[np.uint8], where: NDArray[np.bool_]) -> None:
        """Forget those corners (R, C) of `where` that are none."""
        self.drop(where & ~(sound(gray, self.pixels) & (self.explained > EXPLAINED)))

    def drop(self, where: NDArray[np.bool_]) -> None:
        """Forget corners (R, C)."""
        for array in self._arrays():
            array[where] = np.nan

    def _arrays(self) -> tuple[Array, ...]:
        return self.pixels, self.covariance, self.amplitude, self.blur, self.explained


def contrast(gray: NDArray[np.uint8], lattice: Lattice) -> NDArray[np.float64]:
    """Signed contrast (rows, columns) in gray levels of the four squares that meet in each corner.

    Positive where the squares ahead and behind along the diagonal of the steps are brighter than the other
    two; on a checkerboard the sign alternates from corner to corner. The weakest of the four differences
    counts, so that an edge or a line gives none.
    """
    column, row = steps(lattice)
    sides = [(1, 1), (-1, -1), (1, -1), (-1, 1)]
    offsets = np.stack([s * column + t * row for s, t in sides])
    # Near the corner and amid the squares: both tell, and the border of the paper passes for one at most.
    near, amid = (bilinear(gray, lattice + reach * offsets) for reach in _REACHES)
    ahead = np.minimum(near[:2], amid[:2]), np.maximum(near[:2], amid[:2])
    aside = np.minimum(near[2:], amid[2:]), np.maximum(near[2:], amid[2:])
    brighter = ahead[0].min(axis=0) - aside[1].max(axis=0)
    darker = aside[0].min(axis=0) - ahead[1].max(axis=0)
    return np.maximum(brighter, 0) - np.maximum(darker, 0)


def parity(shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Alternating signs (rows, columns), 1 at [0, 0]."""
    i, j = np.indices(shape[:2])
    return 1.0 - 2.0 * ((i + j) % 2)


def sound(gray: NDArray[np.uint8], lattice: Lattice) -> NDArray[np.bool_]:
    """Whether each corner (rows, columns) is where its neighbours put it, and is one by its colours."""
    alternating = contrast(gray, lattice) * parity(lattice.shape)
    facing = orientation(lattice)
    if not np.isfinite(alternating).any():
        return np.zeros(lattice.shape[:2], bool)
    level, side = np.nanmedian(alternating), np.nanmedian(facing)
    off = np.linalg.norm(lattice - predictions(lattice), axis=-1)
    return (
        (off < _TOLERANCE * spacing(lattice))
        & (alternating * np.sign(level) > FAINT * abs(level))
        & (facing * side > 0)
    )


def completed(gray: NDArray[np.uint8], lattice: Lattice) -> Measured:
    """Measure a lattice, drop what does not belong to it, and grow it as far as the board goes.

    Parameters
    ----------
    gray : (H, W) array of uint8
    lattice : (rows, columns, 2) array
        Corners good to a few pixels.

    Returns
    -------
    Measured
        Of which each outer line is at least half there; of no rows where nothing is left.
    """
    everywhere = np.ones(lattice.shape[:2], bool)
    likely = sound(gray, lattice)  # costs less than measuring what is no board
    found = Measured.empty(lattice.shape)
    if likely.sum() >= _FEWEST:
        found.measure(gray, lattice, likely, rough=True)
        found.check(gray, everywhere)
    for _ in range(_ROUNDS):
        before = seen(found.pixels)
        if before < _FEWEST:
            break
        found = cropped(found).padded()
        missing = np.isnan(found.pixels[..., 0])
        place = predictions(found.pixels)
        found.measure(gray, np.where(missing[..., None], place, found.pixels), missing, rough=True)
        found.check(gray, missing)
        if seen(found.pixels) == before:
            break
    found = trimmed(gray, found)
    return remeasured(gray, found.pixels)  # now that neighbours tell how the edges bend


def remeasured(gray: NDArray[np.uint8], lattice: Lattice) -> Measured:
    """Measure the corners of a lattice (R, C, 2) that are good to a pixel, and drop those that are none."""
    found = Measured.empty(lattice.shape)
    everywhere = np.ones(lattice.shape[:2], bool)
    found.measure(gray, lattice, everywhere)
    found.check(gray, everywhere)
    return trimmed(gray, found)


def cropped(found: Measured) -> Measured:
    """Cut off outer lines that are empty."""
    there = np.isfinite(found.pixels[..., 0])
    rows, columns = (np.flatnonzero(there.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return found.part(slice(0), slice(0))
    return found.part(slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))


def trimmed(gray: NDArray[np.uint8], found: Measured) -> Measured:
    """Cut off outer lines of which less than half is there, the emptiest first.

    Places that nobody could see, outside of the image or of what the lens shows of it, do not count.
    """
    there = np.isfinite(found.pixels[..., 0])
    if not there.any():
        return found.part(slice(0), slice(0))
    counted = there | ~hidden(gray, found)
    top, bottom, left, right = 0, there.shape[0], 0, there.shape[1]
    while top < bottom and left < right:
        part = (slice(top, bottom), slice(left, right))
        filled = [
            a.sum() / max(b.sum(), 1) if a.sum() >= _LEAST_IN_LINE else 0.0
            for a, b in zip(_outer(there[part]), _outer(counted[part]), strict=True)
        ]
        emptiest = int(np.argmin(filled))
        if filled[emptiest] >= _LEAST_FILLED:
            break
        top, bottom = top + (emptiest == 0), bottom - (emptiest == 1)
        left, right = left + (emptiest == 2), right - (emptiest == 3)
    return found.part(slice(top, bottom), slice(left, right))


def _outer(there: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], ...]:
    return there[0], there[-1], there[:, 0], there[:, -1]


def hidden(gray: NDArray[np.uint8], found: Measured) -> NDArray[np.bool_]:
    """Say which missing corners (rows, columns) lie where nothing is to be seen: off the image, or all dark there."""
    lattice = found.pixels
    place = lattice
    for _ in range(3):  # a line with few corners left is continued from one predicted corner to the next
        place = np.where(np.isfinite(place), place, predictions(place))
    column, row = steps(place)
    around = np.stack([place + s * column + t * row for s, t in ((0.3, 0.3), (-0.3, 0.3), (0.3, -0.3), (-0.3, -0.3))])
    dark = bilinear(gray, around).max(axis=0) < _NIGHT * 2 * np.nanmedian(np.abs(found.amplitude))
    size = np.array(gray.shape[::-1])
    outside = ((place < 1) | (place > size - 2)).any(axis=-1)
    return np.isnan(lattice[..., 0]) & (outside | dark)


def seen(lattice: Lattice) -> int:
    """Count the corners that are there."""
    return int(np.isfinite(lattice[..., 0]).sum())
