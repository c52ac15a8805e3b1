"""What is past the sides of a grid of corners: the board's margin, the image's border, or something unknown."""

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.detection_limits import MAX_LEVEL_DIFFERENCE
from omnisight.targets.detectors.checkerboard.lattice import Lattice
from omnisight.targets.subpixel.corner_fit import BORDER_PX
from omnisight.targets.subpixel.interpolation import bilinear

# Squares past the last corners where the margin is sampled: close to the outer edge of the outer squares.
MARGIN = 1.4
# Relative change of the squares' size per line up to which the next edge can be extrapolated.
MAX_SHRINKAGE = 0.35
# Part of the samples along a side that must agree.
MIN_AGREEMENT = 0.6


def grid_borders(
    gray: NDArray[np.uint8], lattice: Lattice, bright: NDArray[np.bool_], contrast: float
) -> tuple[str, str, str, str]:
    """Return what is past the first row, last row, first column and last column, as in `CornerGrid.borders`.

    Parameters
    ----------
    gray : (H, W) array of uint8
    lattice : (R, C, 2) array
    bright : (R + 1, C + 1) array of bool
        Which squares are bright, the outer ones included; [1, 1] is the one between the first corners.
    contrast : float
        Between bright and dark squares, gray levels.
    """
    sides = (
        (lattice, bright[0, 1:-1]),
        (lattice[::-1], bright[-1, 1:-1]),
        (lattice.swapaxes(0, 1), bright[1:-1, 0]),
        (lattice[:, ::-1].swapaxes(0, 1), bright[1:-1, -1]),
    )
    top, bottom, left, right = (_border(gray, lines, outer, contrast) for lines, outer in sides)
    return top, bottom, left, right


def _border(gray: NDArray[np.uint8], lines: Lattice, bright: NDArray[np.bool_], contrast: float) -> str:
    """Return what is past the first row."""
    # Between two corners of a row, extrapolated by a parabola through three rows.
    middle = (lines[:, 1:] + lines[:, :-1]) / 2
    first, step = middle[0], middle[0] - middle[1]
    bend = step - (middle[1] - middle[2]) if len(middle) > 2 else np.zeros_like(step)
    square, margin = (first + s * step + s * (s + 1) / 2 * bend for s in (0.5, MARGIN))
    known = np.isfinite(margin).all(-1)
    if not known.any():
        return "open"
    size = np.array(gray.shape[::-1])
    within = ((margin > BORDER_PX) & (margin < size - 1 - BORDER_PX)).all(-1)
    inner, outer = bilinear(gray, square), bilinear(gray, margin)
    paper = np.where(bright, inner, inner + contrast)
    black = (outer < paper - 0.85 * contrast) & ~(inner > paper - 0.3 * contrast) | (outer < 0.25 * paper)
    is_margin = within & (np.abs(outer - paper) < MAX_LEVEL_DIFFERENCE * contrast)
    # Where squares shrink fast, a further line of them may lie before the margin.
    shrinkage = np.median(np.linalg.norm(bend[known], axis=-1) / np.linalg.norm(step[known], axis=-1))
    if is_margin[known].mean() >= MIN_AGREEMENT and not shrinkage > MAX_SHRINKAGE:
        return "margin"
    return "cut" if (~within | black)[known].mean() >= MIN_AGREEMENT else "open"
