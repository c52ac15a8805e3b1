"""Where two edges cross, to a few hundredths of a pixel, and how sure that is.

The image around a corner is fitted by what a camera makes of one: two edges, straight or gently bent, the product of
their signs blurred by a Gaussian, under light that may change across.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SHARE = 0.42
_WIDEST_SHARE = 0.55
_SMALL = 6.0
"""Half the window's side, over the step to the next corner: `_SHARE`, more where that is less than `_SMALL` px.

The next edge of the board is a whole step away, so it stays outside.
"""

_HALF = (10.0, 6.0)
"""Half the window's side at most, px, past which nothing is won, and the same for a rough look."""

_SETTLED = (5e-3, 5e-2)
"""Steps in px and radians that end the fit."""

_SHORTEST_STEP = 3.0
"""Steps in px below which there is no room for a window between the corners."""

_FLOOR = 0.005
"""Error in px that no model of light, lens or print goes below."""

_MOST_CORRELATED = 8.0
"""How much correlated noise may widen a covariance: more is no noise."""


class Crossings(NamedTuple):
    """What was fitted to N corners; NaN where nothing could be.

    Attributes
    ----------
    pixels : (N, 2) array
    covariance : (N, 2, 2) array
        Of `pixels`, px^2: from the noise that the fit leaves, its correlation between neighbouring pixels included.
    amplitude : (N,) array
        Half the contrast in gray levels; positive where the square ahead, between both steps, is the brighter one.
    blur : (N,) array
        Standard deviation of the blur, px.
    explained : (N,) array
        Share of the image's variation in the window that the model explains, 0 to 1.
    """

    pixels: Array
    covariance: Array
    amplitude: Array
    blur: Array
    explained: Array


def fit_crossings(gray: NDArray[Any], pixels: Array, steps: Array, bends: Array, *, rough: bool = False) -> Crossings:
    """Fit the crossing of two blurred edges to the image around each corner.

    Parameters
    ----------
    gray : (H, W) array of uint8
    pixels : (N, 2) array
        Corners, good to a third of the window.
    steps : (N, 2, 2) array
        Steps in px to the next corner along the first edge and along the second; their directions are where the
        edges' directions start.
    bends : (N, 2, 2) array
        How the two edges bend: an edge runs through c + s step + s^2 bend. Zero where that is unknown.
    rough : bool
        Only look whether there are corners, and where to a tenth of a pixel: in smaller windows, several times faster.
    """
    from omnisight.targets.grids._crossing_kernel import FIGURES, fit

    square = (steps**2).sum(-1)
    length = np.sqrt(square)
    with np.errstate(invalid="ignore", divide="ignore"):
        half = np.maximum(_SHARE * length, np.minimum(_SMALL, _WIDEST_SHARE * length))
        share = np.minimum(half, _HALF[rough]) / length
        normals = np.stack([-steps[..., 1], steps[..., 0]], -1) / length[..., None]
        bend = (bends * normals).sum(-1) / square
        usable = np.isfinite(pixels).all(-1) & np.isfinite(bend).all(-1) & (length.min(axis=1) > _SHORTEST_STEP)
        # Two edges that nearly coincide cross nowhere in particular.
        usable &= np.abs(steps[:, 0, 0] * steps[:, 1, 1] - steps[:, 0, 1] * steps[:, 1, 0]) > 0.2 * length.prod(axis=1)
    figures = np.full((len(pixels), FIGURES), np.nan)
    # Another memory layout would be compiled for anew.
    gray = np.require(gray, np.uint8, ["C", "W"])
    pixels, steps, bend, share = (np.array(a, np.float64, order="C") for a in (pixels, steps, bend, share))
    power = fit(gray, pixels, steps, bend, share, usable, _SETTLED[rough], rough, figures)
    covariance = figures[:, [2, 3, 3, 4]].reshape(-1, 2, 2)
    # Blur in the camera, demosaicking and JPEG spread noise over neighbouring pixels: it averages out less.
    widened = float(np.clip(power[0] / max(power[1], 1e-9), 1.0, _MOST_CORRELATED))
    return Crossings(figures[:, :2], covariance * widened + _FLOOR**2 * np.eye(2), *figures[:, 5:].T)
