"""What the picture says about a lattice: where its corners are, and whether they are corners at all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .lattice import Lattice, orientation, predictions, spacing, steps
from .sampling import bilinear

_WINDOW = 0.33
"""Half side of the sub-pixel window over the distance to the nearest neighbour, which stays outside."""

_HALF_SIZES = (3, 10)
"""Bounds of that half side in px: below there are no gradients to fit, above the edges of a board bend."""

_TOLERANCE = 0.2
"""How far a corner may be from where its neighbours put it, over the distance to the nearest of them."""

_MOST_LINES = 4
"""How many lines a lattice may grow on each side."""

_REACHES = (0.18, 0.28)
"""Where the squares around a corner are looked at, over their diagonals."""

_FAINT = 0.2
"""Contrast across a corner below this part of the board's median is none."""


def refined(gray: NDArray[np.uint8], lattice: Lattice) -> Lattice:
    """Move each corner to the sub-pixel position where all edges around it meet.

    Parameters
    ----------
    gray : (H, W) array of uint8
    lattice : (rows, columns, 2) array
        Corners good to a few pixels.

    Returns
    -------
    (rows, columns, 2) array
        NaN where the corner was missing, stands alone, or did not settle within its window.
    """
    import cv2

    out = np.full_like(lattice, np.nan)
    space = spacing(lattice)
    inside = np.all((lattice > 1) & (lattice < np.array(gray.shape[::-1]) - 2), axis=-1)
    usable = np.isfinite(space) & inside
    half = np.clip(np.round(_WINDOW * np.where(usable, space, 0)), *_HALF_SIZES).astype(int)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-3)
    for size in np.unique(half[usable]):
        chosen = usable & (half == size)
        start = lattice[chosen].astype(np.float32).reshape(-1, 1, 2)
        moved = cv2.cornerSubPix(gray, start.copy(), (int(size), int(size)), (-1, -1), stop)
        shift = np.linalg.norm(moved - start, axis=-1).ravel()
        positions = moved.reshape(-1, 2).astype(np.float64)
        positions[~(shift < 0.8 * size + 1)] = np.nan
        out[chosen] = positions
    return out


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
        & (alternating * np.sign(level) > _FAINT * abs(level))
        & (facing * side > 0)
    )


def repaired(gray: NDArray[np.uint8], lattice: Lattice, rounds: int = 4) -> Lattice:
    """Refine a lattice, then move corners that disagree with their neighbours back, or drop them.

    Corners that are missing but predicted are looked for as well.

    Returns
    -------
    (rows, columns, 2) array
        NaN for corners that were dropped.
    """
    lattice = refined(gray, lattice)
    for _ in range(rounds):
        if not np.isfinite(lattice).any():
            break
        good = sound(gray, lattice)
        if good.all():
            break
        kept = np.where(good[..., None], lattice, np.nan)
        fresh = refined(gray, np.where(good[..., None], lattice, predictions(kept)))
        lattice = np.where(good[..., None], lattice, fresh)
    if not np.isfinite(lattice).any():
        return lattice
    return np.where(sound(gray, lattice)[..., None], lattice, np.nan)


def completed(gray: NDArray[np.uint8], lattice: Lattice) -> Lattice:
    """Repair a lattice, drop what does not belong to it, and grow it by whole lines as far as the board goes.

    Returns
    -------
    (rows, columns, 2) array
        Of which each outer line is at least half seen; of no rows where nothing is left.
    """
    lattice = trimmed(repaired(gray, lattice))
    for _ in range(_MOST_LINES):
        if min(lattice.shape[:2]) < 3:
            break
        wider = np.pad(lattice, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
        wider = trimmed(repaired(gray, wider))
        if seen(wider) <= seen(lattice):
            break
        lattice = wider
    return lattice


def trimmed(lattice: Lattice) -> Lattice:
    """Cut off outer lines of which less than half is there, the emptiest first."""
    there = np.isfinite(lattice[..., 0])
    while lattice.size:
        filled = [float(line.mean()) for line in (there[0], there[-1], there[:, 0], there[:, -1])]
        emptiest = int(np.argmin(filled))
        if filled[emptiest] >= 0.5:
            break
        cut = (np.s_[1:], np.s_[:-1], np.s_[:, 1:], np.s_[:, :-1])[emptiest]
        lattice, there = lattice[cut], there[cut]
    return lattice


def seen(lattice: Lattice) -> int:
    """Count the corners that are there."""
    return int(np.isfinite(lattice[..., 0]).sum())
