"""Finds all grids of checkerboard corners in an image of any lens or mirror."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .ends import side_ends
from .evidence import Measured, completed, parity, remeasured, seen
from .grid import Grid
from .growth import grow_lattices
from .lattice import Lattice, orientation, spacing
from .saddles import find_saddles
from .sampling import bilinear

DETECTOR_VERSION = 2
"""Raise it whenever detections change, for they are cached by it."""

_COARSE_PIXELS = 2_500_000
"""Corners are searched in an image of at most this size, and measured in the full one."""

_LEVELS = ((1.0, False), (0.5, False), (0.25, False), (1.0, True))
"""Scales of the search, and whether to look closely: most boards; blurred, overexposed or large ones; tiny ones."""

_BUSY = 1500
"""Saddle points of which none form a grid that make it hopeless: they are noise."""

_PLENTY = 20
"""Corners of a grid that make it needless to look for tiny boards."""

_SMALLEST = 9
"""Corners that a grid must have, in three rows and three columns at least."""

_SHARP = 3.0
"""Blur in px above which a corner is measured in a smaller image: its windows go a few times as far."""

_TRIED = 8
"""How many of the largest grids of one scale are looked at closely."""

_EXPLAINED = 0.8
"""Share of the variation that two crossing edges explain at half of a board's corners, or it is none."""


def find_grids(gray: NDArray[np.uint8]) -> list[Grid]:
    """Find every grid of checkerboard corners, the one with most corners first.

    Nothing is assumed about the board's size, and nothing about lens or mirror but that they bend smoothly. Every
    corner in a grid agrees with its neighbours and has the colours of one; the others are left out.

    Parameters
    ----------
    gray : (H, W) array of uint8

    Raises
    ------
    ValueError
        If `gray` is not an 8-bit gray image.
    """
    if gray.ndim != 2 or gray.dtype != np.uint8:
        raise ValueError(f"expected a gray image (H, W) of uint8, got shape {gray.shape} of {gray.dtype}")
    pictures = _pyramid(gray)
    grids: list[Grid] = []
    for lattice in _candidates(gray):
        if any(len(grid) >= seen(lattice) and _overlap(lattice, grid) for grid in grids):
            continue
        grid = _measured(pictures, lattice)
        if grid is None:
            continue
        same = [other for other in grids if _overlap(grid.pixels, other)]
        if all(len(grid) > len(other) for other in same):
            grids = [other for other in grids if other not in same] + [grid]
    return sorted(grids, key=len, reverse=True)


def _candidates(gray: NDArray[np.uint8]) -> list[Lattice]:
    """Give lattices of saddle points in the image's pixels, the largest first."""
    import cv2

    found: list[Lattice] = []
    busy = False
    base = min(1.0, (_COARSE_PIXELS / max(gray.size, 1)) ** 0.5)
    for level, fine in _LEVELS:
        size = (round(gray.shape[1] * base * level), round(gray.shape[0] * base * level))
        if min(size) < 16 or (fine and (busy or any(seen(lattice) >= _PLENTY for lattice in found))):
            continue
        picture = gray if size == gray.shape[::-1] else cv2.resize(gray, size, interpolation=cv2.INTER_AREA)
        zoom = np.array(gray.shape[::-1]) / size
        saddles = find_saddles(picture, fine=fine)
        grown = grow_lattices(saddles, _SMALLEST)[:_TRIED]
        busy |= len(saddles.pixels) > _BUSY and not grown
        found += [(lattice + 0.5) * zoom - 0.5 for lattice in grown]
    return sorted(found, key=seen, reverse=True)


def _pyramid(gray: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """Give the image and its halves, down to the size that is searched."""
    import cv2

    pictures = [gray]
    while pictures[-1].size > 2 * _COARSE_PIXELS:
        half = cv2.resize(pictures[-1], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        pictures.append(np.asarray(half, np.uint8))
    return pictures


def _measured(pictures: list[NDArray[np.uint8]], lattice: Lattice) -> Grid | None:
    """Measure a lattice in the largest of the images in which its edges are sharp enough for the windows.

    It is completed in the smallest.
    """
    level = len(pictures) - 1
    found = completed(pictures[level], (lattice + 0.5) / 2**level - 0.5)
    while level > 0 and np.isfinite(found.blur).any() and 2 * np.nanmedian(found.blur) < _SHARP:
        level -= 1
        found = remeasured(pictures[level], 2 * (found.pixels + 0.5) - 0.5)
    grid = as_grid(pictures[level], found)
    return grid if grid is None or level == 0 else grid.enlarged(2**level)


def _overlap(lattice: Lattice, grid: Grid) -> bool:
    """Say whether some of a lattice's corners lie on a grid, which then is the same board."""
    corners = lattice[np.isfinite(lattice[..., 0])]
    known = grid.pixels[grid.there]
    near = np.nanmedian(spacing(grid.pixels))
    away = np.linalg.norm(corners[:, None] - known, axis=-1).min(axis=1)
    return bool((away < 0.7 * near).mean() > 0.2)


def as_grid(gray: NDArray[np.uint8], found: Measured) -> Grid | None:
    """Give a measured lattice its handedness, colours and ends; None if there is too little to be a board."""
    lattice = found.pixels
    if min(lattice.shape[:2]) < 3 or seen(lattice) < _SMALLEST or not np.nanmedian(found.explained) > _EXPLAINED:
        return None
    if np.nanmedian(orientation(lattice)) < 0:
        found = found.mirrored()
        lattice = found.pixels
    ahead = float(np.nanmedian(found.amplitude * parity(lattice.shape)))  # > 0: the square ahead is bright
    contrast = 2 * float(np.nanmedian(np.abs(found.amplitude)))
    i, j = np.indices((lattice.shape[0] + 1, lattice.shape[1] + 1))
    bright = ((i + j) % 2 == 0) == (ahead > 0)
    ends = side_ends(gray, lattice, bright, contrast)
    middles = (lattice[1:, 1:] + lattice[:-1, :-1]) / 2
    white = float(np.nanmedian(bilinear(gray, middles[bright[1:-1, 1:-1]])))
    return Grid(lattice, found.covariance, ahead < 0, ends, contrast, white, float(np.nanmedian(found.blur)))
