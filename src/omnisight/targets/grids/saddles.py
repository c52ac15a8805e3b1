"""Points of a picture around which dark, bright, dark, bright follow each other: corners of a checkerboard, maybe."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .sampling import bilinear

_SIGMA = 1.2
"""Smoothing in px before derivatives are taken."""

_RADIUS = 3.5
_SAMPLES = 32
"""Radius in px and number of samples of the ring around a saddle point."""

_STRONGEST = 3000
"""How many saddle points are kept, the strongest first."""

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
    """

    pixels: NDArray[np.float64]
    rings: NDArray[np.float64]
    edges: NDArray[np.float64]
    amplitude: NDArray[np.float64]


def find_saddles(gray: NDArray[Any]) -> Saddles:
    """Find the points of an (H, W) picture around which dark, bright, dark, bright follow each other."""
    import cv2

    smooth = cv2.GaussianBlur(gray.astype(np.float32), (0, 0), _SIGMA)
    uu, vv, uv = (cv2.Sobel(smooth, cv2.CV_32F, *order, ksize=3) for order in ((2, 0), (0, 2), (1, 1)))
    strength = uv * uv * 4 - uu * vv  # Sobel's mixed kernel weighs half of its straight ones
    peak = (strength >= cv2.dilate(strength, np.ones((5, 5), np.uint8))) & (strength > _FAINTEST**2)
    edge = int(_RADIUS) + 1
    peak[:edge] = peak[-edge:] = False
    peak[:, :edge] = peak[:, -edge:] = False
    v, u = np.nonzero(peak)
    order = np.argsort(-strength[v, u])[:_STRONGEST]
    pixels = np.stack([u[order], v[order]], axis=1).astype(np.float64)
    return _crossings(smooth, pixels)


def _crossings(smooth: NDArray[Any], pixels: NDArray[np.float64]) -> Saddles:
    angle = np.arange(_SAMPLES) * (2 * np.pi / _SAMPLES)
    circle = _RADIUS * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ring = bilinear(smooth, pixels[:, None] + circle)
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
    return Saddles(pixels[good], ring, edges, energy[good] / np.sqrt(_SAMPLES))
