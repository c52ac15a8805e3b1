"""Closed seams of least cost in the overlap of two images, by dynamic programming."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.views.stitching.sampling import PolarGrid

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Rows that a seam can move per column: 60 degrees of slope.
MAX_STEP_ROWS = 2
# Cost of pixels that only one image shows: the seam crosses them only where there is no overlap.
NO_OVERLAP_COST = 1000.0
# Grey levels of cost at the edge of the overlap: without texture the seam is in its middle, where lenses are sharper.
EDGE_COST = 2.0
# Standard deviation of the smoothing of differences, px.
SMOOTHING_PX = 1.5


@dataclass(frozen=True, eq=False)
class Seam:
    """A closed seam around the axis of a camera, which shows the inside.

    Attributes
    ----------
    grid
        The polar grid around the axis.
    row
        (C,) row of the seam of each column.
    """

    grid: PolarGrid
    row: NDArray[np.intp]

    @property
    def theta(self) -> Array:
        """Angle from the axis (C,) of each column."""
        return self.grid.theta[self.row]

    def inside(self, bearings: NDArray[Any]) -> Mask:
        """Return which directions (..., 3) are inside."""
        theta, column = self.grid.coordinates(bearings)
        columns = np.arange(self.grid.columns)
        limit = np.interp(column, columns, self.theta, period=self.grid.columns)
        return theta < limit


def find_seam(grid: PolarGrid, inner: NDArray[Any], outer: NDArray[Any], overlap: Mask) -> Seam:
    """Return the closed path of least cost through the overlap.

    Parameters
    ----------
    grid
        The polar grid of the images.
    inner, outer
        (R, C, 3) both images, uint8.
    overlap
        (R, C) which pixels both show.
    """
    cost = seam_cost(inner, outer, overlap)
    start = int(_least_path(np.concatenate([cost, cost], 1))[cost.shape[1]])
    return Seam(grid, _least_path(cost, start))


def seam_cost(inner: NDArray[Any], outer: NDArray[Any], overlap: Mask) -> Array:
    """Return the cost (R, C) of a seam: differences of colours and of edges, and distance from the middle."""
    import cv2

    a, b = (np.asarray(image, np.float32).mean(-1) for image in (inner, outer))
    difference = np.abs(np.asarray(inner, np.float32) - np.asarray(outer, np.float32)).mean(-1)
    edges = sum(np.abs(cv2.Sobel(a, cv2.CV_32F, *d) - cv2.Sobel(b, cv2.CV_32F, *d)) / 4 for d in ((1, 0), (0, 1)))
    wrapped = np.pad(difference + np.asarray(edges), ((0, 0), (8, 8)), "wrap")
    smooth = cv2.GaussianBlur(wrapped, (0, 0), SMOOTHING_PX)[:, 8:-8]
    first = overlap.argmax(0)
    last = overlap.shape[0] - 1 - overlap[::-1].argmax(0)
    middle, half = (first + last) / 2, np.maximum((last - first) / 2, 1)
    away = np.abs(np.arange(overlap.shape[0])[:, None] - middle) / half
    # The rows next to the edge of an image are the least reliable.
    return np.where(overlap, smooth + EDGE_COST * away**2 + np.where(away > 0.9, 20.0, 0.0), NO_OVERLAP_COST)


def _least_path(cost: Array, start: int = -1) -> NDArray[np.intp]:
    """Return the row (C,) of each column of the path of least cost, which ends where it starts if that is specified."""
    from omnisight.views.stitching._seam_kernel import least_path

    path = np.empty(cost.shape[1], np.intp)
    least_path(cost, MAX_STEP_ROWS, start, path)
    return path
