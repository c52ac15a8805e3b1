"""Complete a lattice: measure its corners, drop false ones, and grow it line by line as far as the board extends."""

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.detection_limits import (
    MAX_LEVEL_DIFFERENCE,
    MIN_EXPLAINED,
    MIN_RELATIVE_CONTRAST,
    SEARCH_RADIUS_STEPS,
)
from omnisight.targets.detectors.checkerboard.lattice import (
    Lattice,
    corner_count,
    orientation,
    parity,
    predictions,
    spacing,
    steps,
)
from omnisight.targets.detectors.checkerboard.measured_lattice import MeasuredLattice
from omnisight.targets.subpixel.corner_fit import BORDER_PX
from omnisight.targets.subpixel.interpolation import bilinear
from omnisight.targets.subpixel.point_fits import MAX_ITERATIONS

# Where the squares around a corner are sampled, over their diagonals: near the corner and amid the square.
SAMPLE_REACHES = (0.18, 0.28)
# Corners below which a lattice has no neighbours to predict from.
MIN_CORNERS_TO_GROW = 6
# Part of the visible corners of an outer line that must be present.
MIN_LINE_SHARE = 0.5


def complete_lattice(gray: NDArray[np.uint8], lattice: Lattice) -> MeasuredLattice:
    """Measure a lattice, drop what does not belong to it, and grow it as far as the board extends.

    Parameters
    ----------
    gray : (H, W) array of uint8
    lattice : (rows, columns, 2) array
        Corners good to a few pixels.

    Returns
    -------
    MeasuredLattice
        At least half of each outer line is present; without rows if no corner remains.
    """
    likely = is_consistent(gray, lattice)  # cheaper than measuring corners of no board
    measured = MeasuredLattice.empty(lattice.shape)
    if likely.sum() >= MIN_CORNERS_TO_GROW:
        measured.measure(gray, lattice, likely, rough=True)
        drop_false_corners(gray, measured)
    for _ in range(MAX_ITERATIONS):
        count = corner_count(measured.pixels)
        if count < MIN_CORNERS_TO_GROW:
            break
        measured = _without_empty_lines(measured).padded()
        missing = ~measured.present
        predicted = predictions(measured.pixels)
        measured.measure(gray, np.where(missing[..., None], predicted, measured.pixels), missing, rough=True)
        drop_false_corners(gray, measured, missing)
        if corner_count(measured.pixels) == count:
            break
    return remeasure(gray, _without_sparse_lines(gray, measured).pixels)  # now that bends are known


def remeasure(gray: NDArray[np.uint8], lattice: Lattice) -> MeasuredLattice:
    """Measure the corners of a lattice (R, C, 2) that are good to a pixel, and drop false ones."""
    measured = MeasuredLattice.empty(lattice.shape)
    measured.measure(gray, lattice, np.ones(lattice.shape[:2], bool))
    drop_false_corners(gray, measured)
    return _without_sparse_lines(gray, measured)


def drop_false_corners(
    gray: NDArray[np.uint8], measured: MeasuredLattice, where: NDArray[np.bool_] | None = None
) -> None:
    """Remove the corners (R, C) of `where`, or of all, that neighbours, colours or the fit contradict."""
    true = is_consistent(gray, measured.pixels) & (measured.explained > MIN_EXPLAINED)
    measured.drop(~true if where is None else where & ~true)


def is_consistent(gray: NDArray[np.uint8], lattice: Lattice) -> NDArray[np.bool_]:
    """Return whether each corner (rows, columns) is where its neighbours predict it and has the board's colours."""
    alternating = signed_contrast(gray, lattice) * parity(lattice.shape)
    area = orientation(lattice)
    if not np.isfinite(alternating).any():
        return np.zeros(lattice.shape[:2], bool)
    level, side = np.nanmedian(alternating), np.nanmedian(area)
    deviation = np.linalg.norm(lattice - predictions(lattice), axis=-1)
    return (
        (deviation < SEARCH_RADIUS_STEPS * spacing(lattice))
        & (alternating * np.sign(level) > MIN_RELATIVE_CONTRAST * abs(level))
        & (area * side > 0)
    )


def signed_contrast(gray: NDArray[np.uint8], lattice: Lattice) -> NDArray[np.float64]:
    """Return the signed contrast (rows, columns), gray levels, of the four squares at each corner.

    It is positive where the squares ahead and behind along the diagonal of the steps are brighter than the other two;
    on a checkerboard the sign alternates. The weakest of the four differences counts: an edge or a line has none.
    """
    column, row = steps(lattice)
    offsets = np.stack([s * column + t * row for s, t in ((1, 1), (-1, -1), (1, -1), (-1, 1))])
    # Near the corner and amid the squares: the border of the paper has the colours of a square in one at most.
    near, amid = (bilinear(gray, lattice + reach * offsets) for reach in SAMPLE_REACHES)
    low, high = np.minimum(near, amid), np.maximum(near, amid)
    brighter = low[:2].min(axis=0) - high[2:].max(axis=0)
    darker = low[2:].min(axis=0) - high[:2].max(axis=0)
    return np.maximum(brighter, 0) - np.maximum(darker, 0)


def _without_empty_lines(measured: MeasuredLattice) -> MeasuredLattice:
    """Return the part between the outermost lines that have corners."""
    rows, columns = (np.flatnonzero(measured.present.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return measured.part(slice(0), slice(0))
    return measured.part(slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))


def _without_sparse_lines(gray: NDArray[np.uint8], measured: MeasuredLattice) -> MeasuredLattice:
    """Return the part without outer lines of which less than half is present; invisible corners do not count."""
    present = measured.present
    if not present.any():
        return measured.part(slice(0), slice(0))
    visible = present | ~_is_hidden(gray, measured)
    top, bottom, left, right = 0, present.shape[0], 0, present.shape[1]
    while top < bottom and left < right:
        part = (slice(top, bottom), slice(left, right))
        shares = [
            a.sum() / max(b.sum(), 1) if a.sum() > 1 else 0.0
            for a, b in zip(_outer_lines(present[part]), _outer_lines(visible[part]), strict=True)
        ]
        sparsest = int(np.argmin(shares))
        if shares[sparsest] >= MIN_LINE_SHARE:
            break
        top, bottom = top + (sparsest == 0), bottom - (sparsest == 1)
        left, right = left + (sparsest == 2), right - (sparsest == 3)
    return measured.part(slice(top, bottom), slice(left, right))


def _outer_lines(mask: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], ...]:
    return mask[0], mask[-1], mask[:, 0], mask[:, -1]


def _is_hidden(gray: NDArray[np.uint8], measured: MeasuredLattice) -> NDArray[np.bool_]:
    """Return which missing corners (rows, columns) are off the image, or in the dark outside of the image circle."""
    lattice = measured.pixels
    filled = lattice
    for _ in range(3):  # a line with few corners left is extrapolated from one predicted corner to the next
        filled = np.where(np.isfinite(filled), filled, predictions(filled))
    column, row = steps(filled)
    around = np.stack([filled + s * column + t * row for s in (-0.3, 0.3) for t in (-0.3, 0.3)])
    dark = bilinear(gray, around).max(axis=0) < MAX_LEVEL_DIFFERENCE * 2 * np.nanmedian(np.abs(measured.amplitude))
    size = np.array(gray.shape[::-1])
    outside = ((filled < BORDER_PX) | (filled > size - 1 - BORDER_PX)).any(axis=-1)
    return np.isnan(lattice[..., 0]) & (outside | dark)
