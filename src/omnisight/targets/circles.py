"""Finds asymmetric grids of circles, however much the lens bends them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .blobs import Blobs, find_blobs
from .boards.circles import CircleGrid
from .circle_lattice import Cells, Lattice, grow_lattices, places
from .detection import Detection
from .grids.sampling import bilinear
from .local_map import LocalMap, local_map

Array = NDArray[np.float64]

_LEAST_SHARE = 0.4
"""Part of the board's discs that must be seen."""

_AGAINST = 0.04
"""Part of the board's discs that may speak against its place, such as one that a hand covers; or one disc."""

_EXPLAINED = 0.8
"""Share of the image's variation around a disc that a blurred ellipse must explain."""

_FAINTEST = 0.25
"""Least contrast of a disc, over the median."""

_STRAY = 0.25
"""How far a disc may be from where its neighbours expect it, over the spacing."""

_OUTLINE = 64
"""Corners of the polygon that stands for a circle."""

_MARGIN = 2.0
"""Distance in px from a disc to the image's edge, at least: one that is cut has its middle elsewhere."""


def detect_circles(gray: NDArray[np.uint8], board: CircleGrid) -> list[Detection]:
    """Find an asymmetric grid of circles, dark on bright or bright on dark.

    Found is the middle of the ellipse that a disc makes, not the image of the disc's middle: `circle_shift` gives
    the difference, once the camera is known. Part of a board is enough where what is around it tells which part.

    With an odd number of rows, a grid and its mirror image are the same but for a turn: the step to the next row is
    taken to be clockwise of the step to the next column. With an even number a mirror image is told, and ids are
    right in it; but the board looks the same upside-down, and the turn that begins nearer the top left of the image
    is taken.

    Parameters
    ----------
    gray : (H, W) array of uint8
    board : CircleGrid

    Returns
    -------
    list of Detection
        One, or none.
    """
    for picture in (gray, 255 - gray):
        blobs = find_blobs(picture)
        for lattice in sorted(grow_lattices(blobs), key=lambda grown: -len(grown.blobs)):
            if len(lattice.blobs) < _LEAST_SHARE * board.size:
                break
            detection = _placed(picture, lattice, blobs, board)
            if detection is not None:
                return [detection]
    return []


def circle_shift(project: Callable[[Array], Array], points: Array, radius: float) -> Array:
    """Give how far the middle of a disc's image is from the image of the disc's middle.

    What is found of a disc is the centroid of the area that it covers in the image. Where scale changes across the
    disc, by perspective or by the lens, that is not where its middle is seen.

    Parameters
    ----------
    project : callable
        Maps points (N, 3) of the board to pixels (N, 2).
    points : (N, 3) array
        Middles on the board, z = 0 all around.
    radius : float
        In the unit of `points`.

    Returns
    -------
    (N, 2) array
        In px: subtract it from what was found.
    """
    turn = (np.arange(_OUTLINE) + 0.5) * (2 * np.pi / _OUTLINE)
    rim = radius * np.stack([np.cos(turn), np.sin(turn), np.zeros(_OUTLINE)], axis=1)
    middle = project(points)
    outline = project((points[:, None] + rim).reshape(-1, 3)).reshape(-1, _OUTLINE, 2) - middle[:, None]
    # The integral over an area is one along its border (Green): for a polygon, a sum over its sides.
    ahead = np.roll(outline, -1, axis=1)
    area = outline[..., 0] * ahead[..., 1] - outline[..., 1] * ahead[..., 0]
    return ((outline + ahead) * area[..., None]).sum(axis=1) / (3 * area.sum(axis=1))[:, None]


def _placed(gray: NDArray[np.uint8], lattice: Lattice, blobs: Blobs, board: CircleGrid) -> Detection | None:
    """Find where a lattice lies on the board, and measure its discs."""
    centres, matrices = blobs.centres[lattice.blobs], blobs.matrices[lattice.blobs]
    empty = _paper(gray, lattice.cells, centres, matrices)
    for mirrored in (False, True):
        likely = places(lattice.cells, empty, board.columns, board.rows, mirrored=mirrored)
        if not likely or likely[0].against > max(1.0, _AGAINST * board.size):
            continue
        kinds = {_canonical(place.ids, board) for place in likely}
        best = min(likely, key=lambda place: float(centres[np.argmin(place.ids % (board.size + 1))].sum()))
        on = best.ids >= 0
        detection = _measured(gray, best.ids[on], centres[on], matrices[on], board)
        if detection is not None:
            return replace(detection, located=len(kinds) == 1)
    return None


def _canonical(ids: NDArray[np.int64], board: CircleGrid) -> tuple[int, ...]:
    """Give the ids of a lattice's discs, in the lattice's order, or what half a turn of the board makes of them.

    The lesser of the two where the board is its own half turn: one key for places that no image can tell apart.
    """
    turns = [ids]
    if board.symmetric:
        turns.append(np.where(ids < 0, ids, board.size - 1 - ids))
    return min(tuple(turn.tolist()) for turn in turns)


def _paper(gray: NDArray[np.uint8], cells: Cells, centres: Array, matrices: Array) -> Cells:
    """Give the cells beside discs (M, 2) where paper is seen and no disc."""
    near = np.unique((cells[:, None] + [(1, 0), (-1, 0), (0, 1), (0, -1)]).reshape(-1, 2), axis=0)
    near = near[~(near[:, None] == cells).all(axis=2).any(axis=1)]
    at = cells.astype(np.float64)
    guess = local_map(at, centres, np.ones(len(at)), near.astype(np.float64), 1.0).pixels
    inside = ((guess > _MARGIN) & (guess < np.array(gray.shape[::-1]) - 1 - _MARGIN)).all(axis=1)
    near, guess = near[inside], guess[inside]
    if not len(near):
        return near
    # Dark and bright as at the nearest disc: its middle, and its surround, a third of a radius outside.
    nearest = np.linalg.norm(centres - guess[:, None], axis=2).argmin(axis=1)
    turn = np.arange(8) * (np.pi / 4)
    rim = 1.3 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    smooth = gray.astype(np.float32)
    dark = bilinear(smooth, centres[nearest])
    around = centres[nearest, None] + rim @ np.swapaxes(matrices[nearest], 1, 2)
    bright = np.median(bilinear(smooth, around), axis=1)
    # All over where a disc would be: what is dark there may be one that was missed, or an obstacle, or the lens's rim.
    shown = np.median(bilinear(smooth, guess[:, None] + 0.4 * rim @ np.swapaxes(matrices[nearest], 1, 2)), axis=1)
    return near[shown > (dark + bright) / 2]


def _measured(
    gray: NDArray[np.uint8], ids: NDArray[np.int64], centres: Array, matrices: Array, board: CircleGrid
) -> Detection | None:
    """Measure the discs that were found, and those that were missed between them."""
    points = board.points[:, :2]
    pixels = np.full((board.size, 2), np.nan)
    pixels[ids] = centres
    rough = _map(pixels, points, points[ids], board)
    if board.diameter is None:
        with np.errstate(invalid="ignore"):
            size = np.linalg.det(matrices) / np.abs(np.linalg.det(rough.jacobian))
        board = replace(board, diameter=min(2 * float(np.sqrt(np.nanmedian(size))), 1.35 * board.spacing))
    covariance, strength = np.full((board.size, 2, 2), np.nan), np.full(board.size, np.nan)
    for wanted in (ids, np.setdiff1d(np.arange(board.size), ids)):
        near = _map(pixels, points, points[wanted], board)
        start = np.where(np.isfinite(pixels[wanted]), pixels[wanted], near.pixels)
        fit = board.measure(gray, start, *near.window(board.reach))
        good = (fit.explained > _EXPLAINED) & (fit.amplitude < 0)
        good &= _inside(gray, fit.pixels, near.jacobian * ((board.diameter or 0.0) / 2))
        pixels[wanted] = np.where(good[:, None], fit.pixels, np.nan)
        covariance[wanted], strength[wanted] = fit.covariance, -fit.amplitude
    there = np.isfinite(pixels[:, 0])
    if not there.any():
        return None
    pixels[~(strength > _FAINTEST * np.median(strength[there]))] = np.nan
    others = _map(pixels, points, points, board, leave_out=True)
    room = np.maximum(_STRAY * board.spacing * np.linalg.norm(others.jacobian, axis=1).min(axis=1), 1.0)
    pixels[~(np.linalg.norm(others.pixels - pixels, axis=1) < room)] = np.nan
    there = np.flatnonzero(np.isfinite(pixels[:, 0]))
    if len(there) < _LEAST_SHARE * board.size:
        return None
    return Detection(there, pixels[there], covariance[there], board=board)


def _map(pixels: Array, points: Array, targets: Array, board: CircleGrid, *, leave_out: bool = False) -> LocalMap:
    there = np.isfinite(pixels[:, 0])
    weights = np.ones(int(there.sum()))
    return local_map(points[there], pixels[there], weights, targets, 1.5 * board.spacing, leave_out=leave_out)


def _inside(gray: NDArray[np.uint8], pixels: Array, matrices: Array) -> NDArray[np.bool_]:
    """Say which ellipses are all in the image."""
    reach = np.linalg.norm(matrices, axis=2) + _MARGIN
    return ((pixels - reach > 0) & (pixels + reach < np.array(gray.shape[::-1]) - 1)).all(axis=1)
