"""Finds a checkerboard in a picture of any lens or mirror."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from .board import Board
from .detection import Detection
from .evidence import completed, contrast, parity, seen
from .growth import find_saddles, grow_lattices
from .lattice import Lattice, orientation

DETECTOR_VERSION = 1
"""Raise it whenever detections change, for they are cached by it."""

_COARSE_PIXELS = 2_500_000
"""Corners are searched in a picture of at most this size, and refined in the full one."""

_LEVELS = (1.0, 0.5, 2.0)
"""Scales of the search: most boards, then blurred or overexposed ones, then tiny ones."""

_TRIED = 4
"""How many of the largest grids of one scale are looked at closely."""

_LEAST_SEEN = 0.6
"""Part of the board's corners below which it counts as not found."""


_CLEAR = 0.9
"""Part of a grid's corners that must be there to take its size for the board's."""


def detect_checkerboard(gray: NDArray[np.uint8], board: Board) -> Detection | None:
    """Find a checkerboard and its corners to sub-pixel accuracy.

    Every corner in the result agrees with its neighbours and has the colours of one; the others are left out,
    so the result may hold part of the board. A grid that goes on beyond the board's size is another board and
    is not accepted.

    Parameters
    ----------
    gray : (H, W) array of uint8
    board : Board
        Columns and rows may be given either way round.

    Returns
    -------
    Detection or None
        Ids in the order that `canonical` describes.

    Raises
    ------
    ValueError
        If `gray` is not an 8-bit gray picture.
    """
    return search_checkerboard(gray, board)[0]


def search_checkerboard(gray: NDArray[np.uint8], board: Board) -> tuple[Detection | None, tuple[int, int] | None]:
    """Do what `detect_checkerboard` does; without success, tell the (columns, rows) of another board seen."""
    best: Lattice | None = None
    other: tuple[int, int] | None = None
    for lattice in find_lattices(gray, smallest=max(9, board.size // 3)):
        if sorted(lattice.shape[:2]) != sorted((board.columns, board.rows)):
            other = other or _clear_pattern(lattice)
        elif best is None or seen(lattice) > seen(best):
            best = lattice
            if seen(best) == board.size:
                break
    if best is None or seen(best) < _LEAST_SEEN * board.size:
        return None, other
    corners = canonical(gray, best, board).reshape(-1, 2)
    ids = np.flatnonzero(np.isfinite(corners[:, 0]))
    return Detection(ids, corners[ids]), None


def guess_pattern(gray: NDArray[np.uint8]) -> tuple[int, int] | None:
    """Find a checkerboard of any size; (columns, rows) of its inner corners, columns >= rows, or None."""
    return next(filter(None, map(_clear_pattern, find_lattices(gray, smallest=9))), None)


def _clear_pattern(lattice: Lattice) -> tuple[int, int] | None:
    rows, columns = sorted(lattice.shape[:2])
    return (columns, rows) if rows >= 3 and seen(lattice) > _CLEAR * rows * columns else None


def find_lattices(gray: NDArray[np.uint8], smallest: int) -> Iterator[Lattice]:
    """Yield grids of checkerboard corners, from the likeliest scale on and the largest first within it.

    Parameters
    ----------
    gray : (H, W) array of uint8
    smallest : int
        Corners that a grid must have to be looked at.
    """
    import cv2

    if gray.ndim != 2 or gray.dtype != np.uint8:
        raise ValueError(f"expected a gray picture (H, W) of uint8, got shape {gray.shape} of {gray.dtype}")
    if min(gray.shape, default=0) < 16:
        return
    base = min(1.0, (_COARSE_PIXELS / gray.size) ** 0.5)
    for scale in (base * level for level in _LEVELS):
        size = (round(gray.shape[1] * scale), round(gray.shape[0] * scale))
        if min(size) < 16 or size[0] * size[1] > 2 * _COARSE_PIXELS:
            continue
        how = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
        picture = gray if scale == 1 else cv2.resize(gray, size, interpolation=how)
        zoom = np.array(gray.shape[::-1]) / size
        grown = sorted(grow_lattices(find_saddles(picture), smallest), key=seen, reverse=True)
        for lattice in grown[:_TRIED]:
            yield completed(gray, (lattice + 0.5) * zoom - 0.5)


def canonical(gray: NDArray[np.uint8], lattice: Lattice, board: Board) -> Lattice:
    """Turn a lattice of the board's size, or of its transpose, into the order of the board's ids.

    The step to the next row is always clockwise of the step to the next column as seen, x right and y down:
    one handedness for all pictures. A mirror in the light path mirrors every picture of a camera alike, so
    this gives them all one board frame.

    Of the two turns that are left (four for a square grid) an asymmetric board decides by colour: the square
    between ids 0, 1, columns and columns + 1 is dark. A symmetric one starts nearest the top left of the
    picture, which another picture or camera may see elsewhere.
    """
    ranked: list[tuple[bool, float, int, Lattice]] = []
    for turns in range(4):
        for mirrored in (0, 1):
            turned = np.rot90(lattice[:, ::-1] if mirrored else lattice, turns)
            if turned.shape[:2] != (board.rows, board.columns) or np.nanmedian(orientation(turned)) < 0:
                continue
            bright = not board.symmetric and np.nanmedian(contrast(gray, turned) * parity(turned.shape)) > 0
            first = turned[np.isfinite(turned[..., 0])][0]
            ranked.append((bool(bright), float(first.sum()), turns, turned))
    return min(ranked, key=lambda rank: rank[:3])[3]
