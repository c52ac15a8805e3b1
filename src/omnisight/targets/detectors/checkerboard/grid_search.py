"""Find all grids of checkerboard corners in an image of any lens or mirror."""

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.detection_limits import MAX_SEARCH_PIXELS, MIN_MEDIAN_EXPLAINED
from omnisight.targets.detectors.checkerboard.corner_grid import CornerGrid
from omnisight.targets.detectors.checkerboard.grid_borders import grid_borders
from omnisight.targets.detectors.checkerboard.growth import grow_lattices
from omnisight.targets.detectors.checkerboard.lattice import Lattice, corner_count, orientation, parity, spacing
from omnisight.targets.detectors.checkerboard.lattice_completion import complete_lattice, remeasure
from omnisight.targets.detectors.checkerboard.measured_lattice import MeasuredLattice
from omnisight.targets.detectors.checkerboard.saddles import find_saddles
from omnisight.targets.subpixel.interpolation import bilinear

Gray = NDArray[np.uint8]

# Scales of the search, and whether it is fine: most boards; blurred, overexposed or large ones; tiny ones.
SCALES = ((1.0, False), (0.5, False), (0.25, False), (1.0, True))
# Corners of a grid, in three rows and three columns at least.
MIN_CORNERS = 9
# Number of saddle points without any lattice that is noise: then the fine scale is skipped, as after a clear board.
MAX_NOISE_SADDLES = 1500
# Largest lattices of a scale that are completed.
MAX_CANDIDATES = 8
# Blur, px, above which a corner is measured in a smaller image: the window must extend a few times as far.
MAX_BLUR_PX = 3.0


def find_grids(gray: Gray) -> list[CornerGrid]:
    """Find every grid of checkerboard corners, the one with most corners first.

    Nothing is assumed about the board's size, and only smoothness about lens or mirror. Every corner agrees with its
    neighbours and has the colours of one; the others are left out.

    Parameters
    ----------
    gray : (H, W) array of uint8
    """
    pyramid = _pyramid(gray)
    grids: list[CornerGrid] = []
    for lattice in _candidate_lattices(gray):
        if any(len(grid) >= corner_count(lattice) and _overlaps(lattice, grid) for grid in grids):
            continue
        grid = _measured_grid(pyramid, lattice)
        if grid is None:
            continue
        same = [other for other in grids if _overlaps(grid.pixels, other)]
        if all(len(grid) > len(other) for other in same):
            grids = [other for other in grids if other not in same] + [grid]
    return sorted(grids, key=len, reverse=True)


def as_grid(gray: Gray, measured: MeasuredLattice) -> CornerGrid | None:
    """Return a measured lattice with its handedness, colours and borders; None if it is too little to be a board."""
    lattice = measured.pixels
    if min(lattice.shape[:2]) < 3 or corner_count(lattice) < MIN_CORNERS:
        return None
    if not np.nanmedian(measured.explained) > MIN_MEDIAN_EXPLAINED:
        return None
    if np.nanmedian(orientation(lattice)) < 0:
        measured = measured.mirrored()
        lattice = measured.pixels
    ahead = float(np.nanmedian(measured.amplitude * parity(lattice.shape)))  # > 0: the square ahead is bright
    contrast = 2 * float(np.nanmedian(np.abs(measured.amplitude)))
    i, j = np.indices((lattice.shape[0] + 1, lattice.shape[1] + 1))
    bright = ((i + j) % 2 == 0) == (ahead > 0)
    borders = grid_borders(gray, lattice, bright, contrast)
    centres = (lattice[1:, 1:] + lattice[:-1, :-1]) / 2
    white = float(np.nanmedian(bilinear(gray, centres[bright[1:-1, 1:-1]])))
    blur = float(np.nanmedian(measured.blur))
    return CornerGrid(lattice, measured.covariance, ahead < 0, borders, contrast, white, blur)


def _candidate_lattices(gray: Gray) -> list[Lattice]:
    """Return the lattices of saddle points of all scales, in the image's pixels, the largest first."""
    import cv2

    lattices: list[Lattice] = []
    noisy = False
    base = min(1.0, (MAX_SEARCH_PIXELS / max(gray.size, 1)) ** 0.5)
    for scale, fine in SCALES:
        size = (round(gray.shape[1] * base * scale), round(gray.shape[0] * base * scale))
        clear = any(corner_count(lattice) >= 2 * MIN_CORNERS for lattice in lattices)
        if min(size) < 16 or (fine and (noisy or clear)):
            continue
        image = gray if size == gray.shape[::-1] else cv2.resize(gray, size, interpolation=cv2.INTER_AREA)
        zoom = np.array(gray.shape[::-1]) / size
        saddles = find_saddles(image, fine=fine)
        grown = grow_lattices(saddles, MIN_CORNERS)[:MAX_CANDIDATES]
        noisy |= len(saddles.pixels) > MAX_NOISE_SADDLES and not grown
        lattices += [(lattice + 0.5) * zoom - 0.5 for lattice in grown]
    return sorted(lattices, key=corner_count, reverse=True)


def _pyramid(gray: Gray) -> list[Gray]:
    """Return the image and its halves, down to the size that is searched."""
    import cv2

    images = [gray]
    while images[-1].size > 2 * MAX_SEARCH_PIXELS:
        half = cv2.resize(images[-1], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        images.append(np.asarray(half, np.uint8))
    return images


def _measured_grid(pyramid: list[Gray], lattice: Lattice) -> CornerGrid | None:
    """Complete a lattice in the smallest image, and measure it in the largest in which its edges are sharp."""
    level = len(pyramid) - 1
    measured = complete_lattice(pyramid[level], (lattice + 0.5) / 2**level - 0.5)
    while level > 0 and np.isfinite(measured.blur).any() and 2 * np.nanmedian(measured.blur) < MAX_BLUR_PX:
        level -= 1
        measured = remeasure(pyramid[level], 2 * (measured.pixels + 0.5) - 0.5)
    grid = as_grid(pyramid[level], measured)
    return grid if grid is None or level == 0 else grid.resized(2**level)


def _overlaps(lattice: Lattice, grid: CornerGrid) -> bool:
    """Return whether some of a lattice's corners lie on a grid, which then is the same board."""
    corners = lattice[np.isfinite(lattice[..., 0])]
    distance = np.linalg.norm(corners[:, None] - grid.pixels[grid.present], axis=-1).min(axis=1)
    return bool((distance < 0.7 * np.nanmedian(spacing(grid.pixels))).mean() > 0.2)
