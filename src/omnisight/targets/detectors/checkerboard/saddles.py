"""Saddle points of an image: candidates for the inner corners of a checkerboard."""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.subpixel.point_fits import MIN_AMPLITUDE

# Smoothing, px, before derivatives; second, for squares of a few pixels.
SIGMA_PX = (1.2, 0.7)
# Radius, px, of the ring that is sampled around a saddle point, about three sigmas, and its number of samples.
RING_RADIUS_PX = (3.5, 2.3)
RING_SAMPLES = 32
# Saddle strength, minus the Hessian's determinant in gray levels squared per px^4, of the faintest corner of
# interest, and its ratio to the median strength in its tile, which is that of noise and texture.
MIN_STRENGTH = 0.3
MIN_STRENGTH_RATIO = 6.0
# The image is divided into so many tiles across and down, each with its own noise; of each the strongest points count.
TILES = 6
MAX_POINTS_PER_TILE = 250
# Correlation of the ring with itself after half a turn: 1 at a corner, 0 in noise.
MIN_SYMMETRY = 0.5


class Saddles(NamedTuple):
    """Saddle points of the image.

    Attributes
    ----------
    pixels : (N, 2) array
        Positions, strongest first.
    rings : (N, S) array
        Brightness on a small circle around each, from direction +u towards +v, with mean 0 and norm 1.
    edges : (N, 2) array
        Directions in radians, mod pi, of the two edges that cross there.
    amplitude : (N,) array
        Half the contrast, in gray levels.
    smooth : (H, W) array of float32
        The smoothed image.
    """

    pixels: NDArray[np.float64]
    rings: NDArray[np.float64]
    edges: NDArray[np.float64]
    amplitude: NDArray[np.float64]
    smooth: NDArray[np.float32]


def find_saddles(gray: NDArray[Any], *, fine: bool = False) -> Saddles:
    """Find the points of an (H, W) image around which dark, bright, dark, bright alternate.

    `fine` smooths less, for squares of a few pixels; it is more sensitive to noise.
    """
    import cv2

    from omnisight.targets.detectors.checkerboard import _saddle_kernel

    sigma = SIGMA_PX[fine]
    radius = RING_RADIUS_PX[fine]
    smooth = cv2.GaussianBlur(gray.astype(np.float32), (0, 0), sigma)
    strengths = _saddle_kernel.saddle_strength(smooth)
    down, across = (np.linspace(0, length, TILES + 1).astype(np.intp) for length in gray.shape)
    tiles = [[strengths[a:b:8, c:d:8] for c, d in pairwise(across)] for a, b in pairwise(down)]
    floor = np.array(
        [[max(MIN_STRENGTH, MIN_STRENGTH_RATIO * float(np.median(np.abs(t)))) for t in row] for row in tiles]
    )
    pixels, strength = _saddle_kernel.find_peaks(strengths, float(floor.min()), round(2 * sigma), int(radius) + 1)
    i, j = (np.searchsorted(ends[1:], pixels[:, k], side="right") for ends, k in ((down, 1), (across, 0)))
    tile = i * TILES + j
    strong = strength > floor.ravel()[tile]
    pixels, strength, tile = pixels[strong], strength[strong], tile[strong]
    order = np.lexsort((-strength, tile))
    first = np.searchsorted(tile[order], np.arange(TILES**2))
    kept = order[np.arange(len(order)) - first[tile[order]] < MAX_POINTS_PER_TILE]
    pixels = pixels[kept[np.argsort(-strength[kept])]]
    return _with_two_edges(smooth, pixels, radius)


def _with_two_edges(smooth: NDArray[Any], pixels: NDArray[np.float64], radius: float) -> Saddles:
    """Keep the saddle points whose ring changes sign four times and repeats after half a turn."""
    from omnisight.targets.detectors.checkerboard import _saddle_kernel

    angle = np.arange(RING_SAMPLES) * (2 * np.pi / RING_SAMPLES)
    circle = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ring = _saddle_kernel.sample_rings(smooth, pixels, circle)
    ring -= ring.mean(axis=1, keepdims=True)
    norm = np.linalg.norm(ring, axis=1)
    ring /= np.maximum(norm, 1e-9)[:, None]
    half = RING_SAMPLES // 2
    symmetry = (ring[:, :half] * ring[:, half:]).sum(axis=1) * 2
    even = (ring[:, :half] + ring[:, half:]) / 2
    following = np.concatenate([even[:, 1:], even[:, :1]], axis=1)
    changes = (even > 0) != (following > 0)
    amplitude = norm / np.sqrt(RING_SAMPLES)
    good = (changes.sum(axis=1) == 2) & (symmetry > MIN_SYMMETRY) & (amplitude > MIN_AMPLITUDE)
    ring, even, following, changes = ring[good], even[good], following[good], changes[good]
    row, k = np.nonzero(changes)
    zero = k + even[row, k] / (even[row, k] - following[row, k])
    edges = (zero * (2 * np.pi / RING_SAMPLES)).reshape(-1, 2)
    return Saddles(pixels[good], ring, edges, amplitude[good], smooth)
