"""How a grid of corners ends on each side: at the board's margin, at the image's, or where nobody can see."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .lattice import Lattice
from .sampling import bilinear

_AMID, _BEYOND = 0.5, 1.4
"""Squares past the last corners: amid the outer squares, and past their outer edge, on the margin."""

_ALIKE = 0.3
"""Two gray levels this part of the board's contrast apart are the same."""

_MOST = 0.6
"""Part of the places along a side that must agree."""

_FASTEST = 0.35
"""Part by which squares may shrink from one line to the next for the place of the next edge to be foretold."""

_BORDER = 1.0
"""Px from the image's edge within which nothing is found."""


def side_ends(
    gray: NDArray[np.uint8], lattice: Lattice, bright: NDArray[np.bool_], contrast: float
) -> tuple[str, str, str, str]:
    """Tell how a lattice ends past its first row, last row, first column and last column.

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
    top, bottom, left, right = (_end(gray, lines, outer, contrast) for lines, outer in sides)
    return top, bottom, left, right


def _end(gray: NDArray[np.uint8], lines: Lattice, bright: NDArray[np.bool_], contrast: float) -> str:
    """Tell how a lattice ends past its first row."""
    # Between two corners of a row, and so many squares before it, along a parabola through three rows.
    middle = (lines[:, 1:] + lines[:, :-1]) / 2
    first, step = middle[0], middle[0] - middle[1]
    bend = step - (middle[1] - middle[2]) if len(middle) > 2 else np.zeros_like(step)
    amid, beyond = (first + s * step + s * (s + 1) / 2 * bend for s in (_AMID, _BEYOND))
    known = np.isfinite(beyond).all(-1)
    if not known.any():
        return "open"
    size = np.array(gray.shape[::-1])
    within = ((beyond > _BORDER) & (beyond < size - 1 - _BORDER)).all(-1)
    inner, outer = bilinear(gray, amid), bilinear(gray, beyond)
    level = np.where(bright, inner, inner + contrast)  # of paper beside the outer square
    black = (outer < level - 0.85 * contrast) & ~(inner > level - 0.3 * contrast) | (outer < 0.25 * level)
    margin = within & (np.abs(outer - level) < _ALIKE * contrast)
    if margin[known].mean() >= _MOST and not _shrinking(step[known], bend[known]):
        return "margin"
    if (~within | black)[known].mean() >= _MOST:
        return "cut"
    return "open"


def _shrinking(step: NDArray[np.float64], bend: NDArray[np.float64]) -> bool:
    """Say whether squares change so fast that a further line of them may hide before the margin."""
    return bool(np.median(np.linalg.norm(bend, axis=-1) / np.linalg.norm(step, axis=-1)) > _FASTEST)
