"""Detect grids of circles: dark blobs, joined to lattices, assigned to the board, and measured."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.boards.circles import CircleGrid
from omnisight.targets.detection_limits import (
    MIN_BOARD_SHARE,
    MIN_MEDIAN_EXPLAINED,
    MIN_RELATIVE_CONTRAST,
    SEARCH_RADIUS_STEPS,
)
from omnisight.targets.detections import Detection
from omnisight.targets.detectors.circles.blobs import Blobs, find_blobs
from omnisight.targets.detectors.circles.disc_lattice import Cells, DiscLattice, board_positions, grow_lattices
from omnisight.targets.subpixel.corner_fit import BORDER_PX
from omnisight.targets.subpixel.ellipse_fit import fit_ellipses
from omnisight.targets.subpixel.interpolation import bilinear
from omnisight.targets.subpixel.local_map import LocalMap, local_map
from omnisight.targets.subpixel.point_fits import PointFits

Array = NDArray[np.float64]

# Part of the board's discs that may contradict its position, such as one that a hand covers; or one disc.
MAX_CONTRADICTIONS = 0.04
# Radius around a disc's centre, over the distance of the next one, that is free of others: almost half.
CLEARANCE_SHARE = 0.495
# Largest diameter of a disc over the distance of the next one.
MAX_DIAMETER_SHARE = 0.955


def detect(gray: NDArray[np.uint8], board: CircleGrid) -> list[Detection]:
    """Detect a grid of circles, dark on bright or bright on dark.

    What is measured is the centre of a disc's image, not the image of its centre: `CircleGrid.measurement_offset`
    is the difference, once the camera is known. Part of a board is enough if its surroundings show which part.

    With an odd number of staggered rows, a grid and its mirror image differ by a rotation only: the step to the next
    row is taken to be clockwise of the step to the next column. With an even number, a mirror image is recognized and
    its ids are right; but the board looks the same upside-down, and the rotation that begins nearer the top left of the
    image is taken. Straight rows and their mirror image look the same, and are taken as not mirrored.

    Returns
    -------
    list of Detection
        One, or none.
    """
    for image in (gray, 255 - gray):
        blobs = find_blobs(image)
        for lattice in sorted(grow_lattices(blobs), key=lambda lattice: -len(lattice.blobs)):
            if len(lattice.blobs) < MIN_BOARD_SHARE * board.size:
                break
            detection = _assign_and_measure(image, lattice, blobs, board)
            if detection is not None:
                return [detection]
    return []


def measure(gray: NDArray[Any], board: CircleGrid, pixels: Array, steps: Array, bends: Array) -> PointFits:
    """Measure the centres of the discs' images near predicted pixels; NaN for discs that the image border cuts."""
    radius = (board.diameter or board.spacing) / 2
    matrices = np.swapaxes(steps, 1, 2) * (radius / board.window_step)
    fits = fit_ellipses(gray, pixels, matrices, CLEARANCE_SHARE * board.pitch / radius)
    whole = _is_inside(gray, fits.pixels, np.linalg.norm(matrices, axis=2))
    failed = PointFits.empty(len(pixels))
    return PointFits(
        *(np.where(whole.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in zip(fits, failed, strict=True))
    )


def _assign_and_measure(
    gray: NDArray[np.uint8], lattice: DiscLattice, blobs: Blobs, board: CircleGrid
) -> Detection | None:
    """Find the position of a lattice on the board, and measure its discs."""
    centres, matrices = blobs.centres[lattice.blobs], blobs.matrices[lattice.blobs]
    empty = _paper_cells(gray, lattice.cells, centres, matrices)
    for mirrored in (False, True):
        positions = board_positions(lattice.cells, empty, board, mirrored=mirrored)
        if not positions or positions[0].contradictions > max(1.0, MAX_CONTRADICTIONS * board.size):
            continue
        distinct = {_canonical_ids(position.ids, board) for position in positions}
        first = min(positions, key=lambda p: float(centres[np.argmin(p.ids % (board.size + 1))].sum()))
        on_board = first.ids >= 0
        detection = _measured(gray, first.ids[on_board], centres[on_board], matrices[on_board], board)
        if detection is not None:
            return replace(detection, located=len(distinct) == 1)
    return None


def _canonical_ids(ids: NDArray[np.int64], board: CircleGrid) -> tuple[int, ...]:
    """Return the least of a lattice's ids under the rotations of the board onto itself: equal if they look equal."""
    rotations = [ids]
    if board.is_symmetric:
        rotations.append(np.where(ids < 0, ids, board.size - 1 - ids))
    if board.columns == board.rows and not board.is_staggered:
        row, column = np.divmod(ids, board.columns)
        quarter = np.where(ids < 0, ids, column * board.columns + board.columns - 1 - row)
        rotations += [quarter, np.where(ids < 0, ids, board.size - 1 - quarter)]
    return min(tuple(ids.tolist()) for ids in rotations)


def _paper_cells(gray: NDArray[np.uint8], cells: Cells, centres: Array, matrices: Array) -> Cells:
    """Return the cells beside discs (M, 2) that show paper and no disc."""
    near = np.unique((cells[:, None] + [(1, 0), (-1, 0), (0, 1), (0, -1)]).reshape(-1, 2), axis=0)
    near = near[~(near[:, None] == cells).all(axis=2).any(axis=1)]
    known = cells.astype(np.float64)
    near_pixels = local_map(known, centres, np.ones(len(known)), near.astype(np.float64), 1.0).pixels
    inside = _is_inside(gray, near_pixels, np.zeros(2))
    near, near_pixels = near[inside], near_pixels[inside]
    if not len(near):
        return near
    # Dark and bright are those of the nearest disc: its centre, and its surround, a third of a radius outside.
    nearest = np.linalg.norm(centres - near_pixels[:, None], axis=2).argmin(axis=1)
    turn = np.arange(8) * (np.pi / 4)
    rim = 1.3 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    smooth = gray.astype(np.float32)
    dark = bilinear(smooth, centres[nearest])
    outlines = rim @ np.swapaxes(matrices[nearest], 1, 2)
    bright = np.median(bilinear(smooth, centres[nearest, None] + outlines), axis=1)
    # All over where a disc would be: what is dark there may be a missed disc, an obstacle, or the image circle's edge.
    seen = np.median(bilinear(smooth, near_pixels[:, None] + 0.4 * outlines), axis=1)
    return near[seen > (dark + bright) / 2]


def _measured(
    gray: NDArray[np.uint8], ids: NDArray[np.int64], centres: Array, matrices: Array, board: CircleGrid
) -> Detection | None:
    """Measure the discs of the lattice, then those that were missed, and drop what neighbours contradict."""
    points = board.points[:, :2]
    pixels = np.full((board.size, 2), np.nan)
    pixels[ids] = centres
    if board.diameter is None:
        board = replace(board, diameter=_estimate_diameter(_map(pixels, points, points[ids], board), matrices, board))
    covariance, amplitude = np.full((board.size, 2, 2), np.nan), np.full(board.size, np.nan)
    for wanted in (ids, np.setdiff1d(np.arange(board.size), ids)):
        near = _map(pixels, points, points[wanted], board)
        start = np.where(np.isfinite(pixels[wanted]), pixels[wanted], near.pixels)
        fits = measure(gray, board, start, *near.window(board.window_step))
        good = (fits.explained > MIN_MEDIAN_EXPLAINED) & (fits.amplitude < 0)
        pixels[wanted] = np.where(good[:, None], fits.pixels, np.nan)
        covariance[wanted], amplitude[wanted] = fits.covariance, -fits.amplitude
    present = np.isfinite(pixels[:, 0])
    if not present.any():
        return None
    pixels[~(amplitude > MIN_RELATIVE_CONTRAST * np.median(amplitude[present]))] = np.nan
    predicted = _map(pixels, points, points, board, leave_out=True)
    radius = np.maximum(SEARCH_RADIUS_STEPS * board.spacing * predicted.min_scale, 1.0)
    pixels[~(np.linalg.norm(predicted.pixels - pixels, axis=1) < radius)] = np.nan
    detected = np.flatnonzero(np.isfinite(pixels[:, 0]))
    if len(detected) < MIN_BOARD_SHARE * board.size:
        return None
    return Detection(detected, pixels[detected], covariance[detected], board=board)


def _estimate_diameter(rough: LocalMap, matrices: Array, board: CircleGrid) -> float:
    """Return the diameter of the discs on the board, from their outlines."""
    with np.errstate(invalid="ignore"):
        squares = np.linalg.det(matrices) / np.abs(np.linalg.det(rough.jacobian))
    return min(2 * float(np.sqrt(np.nanmedian(squares))), MAX_DIAMETER_SHARE * board.pitch)


def _map(pixels: Array, points: Array, targets: Array, board: CircleGrid, *, leave_out: bool = False) -> LocalMap:
    known = np.isfinite(pixels[:, 0])
    weights = np.ones(int(known.sum()))
    return local_map(points[known], pixels[known], weights, targets, 1.5 * board.spacing, leave_out=leave_out)


def _is_inside(gray: NDArray[np.uint8], pixels: Array, radii: Array) -> NDArray[np.bool_]:
    """Return whether boxes of half-sides `radii` are in the image."""
    low, high = pixels - radii, pixels + radii
    inside = (low > BORDER_PX) & (high < np.array(gray.shape[::-1]) - 1 - BORDER_PX)
    return np.asarray(inside.all(axis=1), np.bool_)
