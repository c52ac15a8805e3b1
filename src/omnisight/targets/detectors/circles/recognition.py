"""Recognize an unspecified grid of circles: its columns and rows, and how they are arranged."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.detectors.circles.blobs import Blobs, find_blobs
from omnisight.targets.detectors.circles.disc_lattice import DiscLattice, grow_lattices

# Discs of a grid at least, and in a row or column: fewer are found by chance.
MIN_GRID_DISCS, MIN_LINE_DISCS = 12, 3


class DiscArrangement(NamedTuple):
    """Circles in complete rows.

    Attributes
    ----------
    columns, rows : int
        Circles in a row, and rows.
    is_staggered : bool
        Whether every second row is shifted by half a step.
    diameter : float
        Of a circle, over the spacing of the board.
    """

    columns: int
    rows: int
    is_staggered: bool
    diameter: float


def recognize_discs(gray: NDArray[np.uint8]) -> DiscArrangement | None:
    """Return the arrangement of the largest complete grid of circles in an image (H, W); None if there is none."""
    found: list[tuple[int, DiscArrangement]] = []
    for image in (gray, 255 - gray):
        blobs = find_blobs(image)
        for lattice in grow_lattices(blobs):
            if (arrangement := _arrangement(lattice, blobs)) is not None:
                found.append((len(lattice.blobs), arrangement))
    return max(found, default=(0, None))[1]


def _arrangement(lattice: DiscLattice, blobs: Blobs) -> DiscArrangement | None:
    """Return the arrangement of a lattice that fills a rectangle, upright or on its corner."""
    count, cells = len(lattice.blobs), lattice.cells
    if count < MIN_GRID_DISCS:
        return None
    across, down = sorted((np.ptp(cells, axis=0) + 1).tolist(), reverse=True)
    if count == across * down and down >= MIN_LINE_DISCS:
        return DiscArrangement(across, down, False, _diameter(lattice, blobs))
    turned = np.stack([cells[:, 0] - cells[:, 1], cells[:, 0] + cells[:, 1]], axis=1)
    # A row of c circles is 2c spacings long, so an odd extent is the number of rows; of two even ones, the larger.
    wide, rows = sorted((np.ptp(turned, axis=0) + 1).tolist(), key=lambda extent: (extent % 2, extent))
    if 2 * count == wide * rows and wide % 2 == 0 and min(wide // 2, rows) >= MIN_LINE_DISCS:
        return DiscArrangement(wide // 2, rows, True, _diameter(lattice, blobs) * 2**0.5)
    return None


def _diameter(lattice: DiscLattice, blobs: Blobs) -> float:
    """Return the diameter of the discs over the distance of neighbours, from the areas of discs and cells."""
    index = {tuple(cell): blob for cell, blob in zip(lattice.cells.tolist(), lattice.blobs.tolist(), strict=True)}
    squares: list[float] = []
    for (i, j), blob in index.items():
        if (right := index.get((i + 1, j))) is not None and (below := index.get((i, j + 1))) is not None:
            steps = blobs.centres[[right, below]] - blobs.centres[blob]
            squares.append(float(np.linalg.det(blobs.matrices[blob]) / abs(np.linalg.det(steps))))
    return 2 * float(np.sqrt(np.median(squares)))
