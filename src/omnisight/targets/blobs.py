"""Dark spots in a picture that may be discs, whatever ellipse a lens makes of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Array = NDArray[np.float64]

_LARGEST = 2.0
"""Megapixels that a larger picture is reduced to: discs that then are too small are too small to measure well."""

_WINDOWS = (1 / 30, 1 / 10, 1 / 3)
"""Sides of the windows whose mean brightness is the threshold, over the picture's shorter side."""

_DARKER = 6.0
"""Gray levels that a spot must be darker than the mean around it."""

_SHORTEST = 10
"""Length of an outline in px below which it is noise."""

_MOST = 4000
"""How many outlines are looked at, the longest first: a noisy picture has a hundred thousand."""

_UNEVEN = (0.05, 0.25)
"""How far an outline may be off the ellipse of its moments: standard deviation over the radius, plus px."""

_FLATTEST = 8.0
"""Greatest ratio of an ellipse's axes."""


class Blobs(NamedTuple):
    """Dark ellipses, the most even first.

    Attributes
    ----------
    centres : (N, 2) array, px
    matrices : (N, 2, 2) array
        Symmetric; each maps the unit circle onto the outline, px.
    """

    centres: Array
    matrices: Array


def find_blobs(gray: NDArray[np.uint8]) -> Blobs:
    """Find dark ellipses of any size in a gray picture (H, W)."""
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
        kept += [blob for o in outlines if (blob := _blob(o.reshape(-1, 2).astype(np.float64))) is not None]
    kept.sort(key=lambda blob: blob[0])
    if not kept:
        return Blobs(np.zeros((0, 2)), np.zeros((0, 2, 2)))
    centres, matrices = np.array([b[1] for b in kept]), np.array([b[2] for b in kept])
    first = _distinct(centres, np.sqrt(np.linalg.det(matrices)))
    return Blobs((centres[first] + 0.5) / scale - 0.5, matrices[first] / scale)


def _blob(outline: Array) -> tuple[float, Array, Array] | None:
    """Give how uneven an outline (N, 2) is, its centroid and its matrix; None if it is no ellipse."""
    x, y = (outline - outline[0]).T
    x1, y1 = np.roll(x, -1), np.roll(y, -1)
    cross = x * y1 - x1 * y
    area = float(cross.sum()) / 2
    # Outlines of dark spots run one way around, of bright holes the other.
    if abs(area) < 4:
        return None
    cx, cy = float(((x + x1) * cross).sum()) / (6 * area), float(((y + y1) * cross).sum()) / (6 * area)
    xx = float(((x * x + x * x1 + x1 * x1) * cross).sum()) / (12 * area) - cx * cx
    yy = float(((y * y + y * y1 + y1 * y1) * cross).sum()) / (12 * area) - cy * cy
    xy = float(((x * (2 * y + y1) + x1 * (2 * y1 + y)) * cross).sum()) / (24 * area) - cx * cy
    # Of an ellipse the second moments are a quarter of its squared axes. Its outline runs through pixels' middles.
    variance, axes = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
    if variance[0] <= 0 or variance[1] > _FLATTEST**2 * variance[0]:
        return None
    radii = 2 * np.sqrt(variance)
    away = (np.stack([x, y], axis=1) - (cx, cy)) @ axes / radii
    uneven = float(np.hypot(away[:, 0], away[:, 1]).std())
    if uneven > _UNEVEN[0] + _UNEVEN[1] / radii[0]:
        return None
    return uneven, outline[0] + (cx, cy), axes * (radii + 0.5) @ axes.T


def _distinct(centres: Array, radii: Array) -> NDArray[np.int64]:
    """Give the blobs that are not inside an earlier one's middle half."""
    tree = cKDTree(centres)
    free = np.ones(len(centres), bool)
    for k, near in enumerate(tree.query_ball_point(centres, radii / 2)):
        if free[k]:
            free[[other for other in near if other > k]] = False
    return np.flatnonzero(free)
