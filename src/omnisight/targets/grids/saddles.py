"""Points of an image around which dark, bright, dark, bright follow each other: corners of a checkerboard, maybe."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

_SIGMA = (1.2, 0.7)
"""Smoothing in px before derivatives are taken."""

_APART = (2, 1)
"""Px around a point that hold no stronger one."""

_WEAKEST = 0.3
"""Determinant of second derivatives, gray levels squared per px^4, below which there is no saddle."""

_RADIUS = (3.5, 2.3)
_SAMPLES = 32
"""Radius in px and number of samples of the ring around a saddle point."""

_TILES = 6
"""The image is looked at in so many parts across and down, each with its own texture and noise."""

_NOISE = 6.0
"""The same over the median in that part of the image, most of which is no corner."""

_STRONGEST = 250
"""How many saddle points are kept in each part, the strongest first."""

_FAINTEST = 3.0
"""Amplitude in gray levels around a saddle point below which it is noise."""


class Saddles(NamedTuple):
    """Points where dark and bright cross.

    Attributes
    ----------
    pixels : (N, 2) array
        Positions, strongest first.
    rings : (N, S) array
        Brightness on a small circle around each, from direction +u towards +v, mean 0 and length 1.
    edges : (N, 2) array
        Directions in radians, mod pi, of the two edges that cross there.
    amplitude : (N,) array
        Half the contrast, in gray levels.
    smooth : (H, W) array of float32
        The smoothed image that they were found in.
    """

    pixels: NDArray[np.float64]
    rings: NDArray[np.float64]
    edges: NDArray[np.float64]
    amplitude: NDArray[np.float64]
    smooth: NDArray[np.float32]


def find_saddles(gray: NDArray[Any], *, fine: bool = False) -> Saddles:
    """Find the points of an (H, W) image around which dark, bright, dark, bright follow each other.

    Looked at less smoothed and more closely where `fine`: squares of a few pixels need that, and noise forbids it.
    """
    import cv2

    from ._saddle_kernel import find_peaks, saddle_strength

    smooth = cv2.GaussianBlur(gray.astype(np.float32), (0, 0), _SIGMA[fine])
    strengths = saddle_strength(smooth)
    down, across = (np.linspace(0, length, _TILES + 1).astype(np.intp) for length in gray.shape)
    some = [[strengths[a:b:8, c:d:8] for c, d in pairwise(across)] for a, b in pairwise(down)]
    floor = np.array([[max(_WEAKEST, _NOISE * float(np.median(np.abs(part)))) for part in row] for row in some])
    pixels, strength = find_peaks(strengths, float(floor.min()), _APART[fine], int(_RADIUS[fine]) + 1)
    i, j = (np.searchsorted(ends[1:], pixels[:, k], side="right") for ends, k in ((down, 1), (across, 0)))
    tile = i * _TILES + j
    strong = strength > floor.ravel()[tile]
    pixels, strength, tile = pixels[strong], strength[strong], tile[strong]
    order = np.lexsort((-strength, tile))
    first = np.searchsorted(tile[order], np.arange(_TILES**2))
    kept = order[np.arange(len(order)) - first[tile[order]] < _STRONGEST]
    pixels = pixels[kept[np.argsort(-strength[kept])]]
    return _crossings(smooth, pixels, _RADIUS[fine])


def _crossings(smooth: NDArray[Any], pixels: NDArray[np.float64], radius: float) -> Saddles:
    from ._saddle_kernel import sample_rings

    angle = np.arange(_SAMPLES) * (2 * np.pi / _SAMPLES)
    circle = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ring = sample_rings(smooth, pixels, circle)
    ring -= ring.mean(axis=1, keepdims=True)
    energy = np.linalg.norm(ring, axis=1)
    ring /= np.maximum(energy, 1e-9)[:, None]
    half = _SAMPLES // 2
    opposite = (ring[:, :half] * ring[:, half:]).sum(axis=1) * 2  # 1 where the ring repeats after half a turn
    even = (ring[:, :half] + ring[:, half:]) / 2
    following = np.concatenate([even[:, 1:], even[:, :1]], axis=1)
    flips = (even > 0) != (following > 0)
    good = (flips.sum(axis=1) == 2) & (opposite > 0.5) & (energy > _FAINTEST * np.sqrt(_SAMPLES))
    ring, even, following, flips = ring[good], even[good], following[good], flips[good]
    row, k = np.nonzero(flips)
    crossing = k + even[row, k] / (even[row, k] - following[row, k])
    edges = (crossing * (2 * np.pi / _SAMPLES)).reshape(-1, 2)
    return Saddles(pixels[good], ring, edges, energy[good] / np.sqrt(_SAMPLES), smooth)
