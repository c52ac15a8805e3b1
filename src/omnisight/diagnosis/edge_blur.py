"""Width of the edges of an image."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Mask = NDArray[np.bool_]

# Standard deviations of the blur that reduces noise, and of the additional one, px.
SMOOTHING_PX, REBLUR_PX = 0.7, 1.5
# Variance (square px) of the kernel of the central difference, which widens edges too.
DERIVATIVE_VARIANCE_PX2 = 1 / 3
# Directions of edges that are measured separately: motion blurs only the edges across it.
DIRECTIONS = 4
# Edges: peaks of the gradient (gray levels per px) above the noise of a dark image.
MIN_GRADIENT, MIN_EDGES = 4.0, 60


def edge_blur(gray: Bytes, region: Mask) -> float:
    """Return the standard deviation (px) of the blur of edges, in the direction in which it is largest; NaN without.

    The ratio R of the gradient of an edge to that after an additional blur of s is sqrt(1 + (s/sigma)^2) (S. Zhuo and
    T. Sim, Defocus map estimation from a single image, Pattern Recognition 44, 2011).

    Parameters
    ----------
    gray
        (H, W).
    region
        (H, W) pixels to use.
    """
    import cv2

    smooth = cv2.GaussianBlur(gray.astype(np.float32), (0, 0), SMOOTHING_PX)
    gx, gy = _gradient(smooth)
    bx, by = _gradient(cv2.GaussianBlur(smooth, (0, 0), REBLUR_PX))
    magnitude, after = np.hypot(gx, gy), np.hypot(bx, by)
    inner = cv2.erode(region.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    is_peak = (magnitude >= cv2.dilate(magnitude, np.ones((3, 3), np.uint8))) & (magnitude > MIN_GRADIENT) & inner
    ratio = magnitude[is_peak] / np.maximum(after[is_peak], 1e-6)
    direction = (np.arctan2(gy[is_peak], gx[is_peak]) / np.pi * DIRECTIONS + 0.5).astype(int) % DIRECTIONS
    widest = float("nan")
    for k in range(DIRECTIONS):
        ratios = ratio[direction == k]
        if len(ratios) >= MIN_EDGES:
            total = REBLUR_PX**2 / max(float(np.median(ratios)) ** 2 - 1.0, 1e-6)
            own = total - SMOOTHING_PX**2 - DERIVATIVE_VARIANCE_PX2
            widest = float(np.fmax(widest, np.sqrt(max(own, 0.0))))
    return widest


def _gradient(image: NDArray[Any]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the central differences (H, W) along x and y."""
    import cv2

    kernel, one = np.array([-0.5, 0.0, 0.5]), np.array([1.0])
    return (
        np.asarray(cv2.sepFilter2D(image, cv2.CV_32F, kernel, one), np.float32),
        np.asarray(cv2.sepFilter2D(image, cv2.CV_32F, one, kernel), np.float32),
    )
