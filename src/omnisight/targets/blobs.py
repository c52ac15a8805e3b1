"""Dark spots in an image that may be discs, whatever ellipse a lens makes of them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

Array = NDArray[np.float64]

_LARGEST = 2.0
"""Megapixels that a larger image is reduced to: discs that then are too small are too small to measure well."""

_WINDOWS = (1 / 30, 1 / 10, 1 / 3)
"""Sides of the windows whose mean brightness is the threshold, over the image's shorter side."""

_DARKER = 6.0
"""Gray levels that a spot must be darker than the mean around it."""

_SHORTEST = 10
"""Length of an outline in px below which it is noise."""

_LEAST_AREA = 4.0  # px^2

_CONVEX = 0.85
"""Least area of an outline over that of its hull; pixels make a small disc's a little jagged."""

_MOST = 4000
"""How many outlines are looked at, the longest first: a noisy image has a hundred thousand."""

_UNEVEN = (0.05, 0.25)
"""How far an outline may be off the ellipse of its moments: standard deviation over the radius, plus px."""

_FLATTEST = 8.0
"""Greatest ratio of an ellipse's axes."""


class Blobs(NamedTuple):
    """Dark ellipses, the most even first.

    Attributes
    ----------
    centres : (N, 2) array
        In px.
    matrices : (N, 2, 2) array
        Symmetric; each maps the unit circle onto the outline, px.
    """

    centres: Array
    matrices: Array


def find_blobs(gray: NDArray[np.uint8]) -> Blobs:
    """Find dark ellipses of any size in a gray image (H, W)."""
    import cv2

    scale = min(1.0, (_LARGEST * 1e6 / max(gray.size, 1)) ** 0.5)
    if min(gray.shape) * scale < 8:
        return Blobs(np.zeros((0, 2)), np.zeros((0, 2, 2)))
    small = gray if scale == 1 else cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), 1.0)
    kept: list[tuple[float, Array, Array]] = []
    for share in _WINDOWS:
        side = int(min(small.shape) * share) // 2 * 2 + 3
        dark = cv2.adaptiveThreshold(small, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, side, _DARKER)
        outlines = cv2.findContours(dark, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)[0]
        longest = max(small.shape) * 2
        outlines = [o for o in outlines if _SHORTEST <= len(o) <= longest]
        if len(outlines) > _MOST:
            outlines = sorted(outlines, key=len, reverse=True)[:_MOST]
        kept += [blob for o in outlines if (blob := _blob(o)) is not None]
    kept.sort(key=lambda blob: blob[0])
    if not kept:
        return Blobs(np.zeros((0, 2)), np.zeros((0, 2, 2)))
    centres, matrices = np.array([b[1] for b in kept]), np.array([b[2] for b in kept])
    first = _distinct(centres, np.sqrt(np.linalg.det(matrices)))
    return Blobs((centres[first] + 0.5) / scale - 0.5, matrices[first] / scale)


def _blob(outline: NDArray[Any]) -> tuple[float, Array, Array] | None:
    """Give how uneven an outline (N, 1, 2) is, its centroid and its matrix; None if it is no ellipse."""
    import cv2

    hull = cv2.contourArea(cv2.convexHull(outline))
    if hull < _LEAST_AREA or cv2.contourArea(outline) < _CONVEX * hull:
        return None
    m = cv2.moments(outline)
    centre = np.array([m["m10"], m["m01"]]) / m["m00"]
    # Of an ellipse the second moments are a quarter of its squared axes.
    variance, axes = np.linalg.eigh(np.array([[m["mu20"], m["mu11"]], [m["mu11"], m["mu02"]]]) / m["m00"])
    if variance[0] <= 0 or variance[1] > _FLATTEST**2 * variance[0]:
        return None
    radii = 2 * np.sqrt(variance)
    uneven = float(np.linalg.norm((outline[:, 0] - centre) @ axes / radii, axis=1).std())
    if uneven > _UNEVEN[0] + _UNEVEN[1] / radii[0]:
        return None
    # The outline runs through the middles of pixels: half a pixel inside.
    return uneven, centre, axes * (radii + 0.5) @ axes.T


def _distinct(centres: Array, radii: Array) -> NDArray[np.int64]:
    """Give the blobs that are not an earlier one seen again: of about its size, in its middle half."""
    free = np.ones(len(centres), bool)
    for k, near in enumerate(KDTree(centres).query_ball_point(centres, radii / 2)):
        if free[k]:
            later = [other for other in near if other > k and 0.5 < radii[other] / radii[k] < 2]
            free[later] = False
    return np.flatnonzero(free)
