"""Dark elliptical blobs of an image: candidates for the discs of a circle grid."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.detection_limits import MAX_SEARCH_PIXELS
from omnisight.targets.subpixel.ellipse_fit import MIN_RADIUS_PX
from omnisight.targets.subpixel.point_fits import MIN_AMPLITUDE

Array = NDArray[np.float64]

# Sides of the windows whose mean is the threshold, over the image's shorter side: for discs of all sizes.
WINDOW_SIDES = (1 / 30, 1 / 10, 1 / 3)
# Gray levels by which a blob is darker than the mean around it.
MIN_DARKNESS = 2 * MIN_AMPLITUDE
# Area of an outline over that of its convex hull; the pixels of a small disc make it slightly jagged.
MIN_CONVEXITY = 0.85
# Longest outlines that are examined: a noisy image has a hundred thousand.
MAX_OUTLINES = 4000
# Standard deviation of an outline from the ellipse of its moments, over the radius: of a lens, plus px of sampling.
MAX_ROUGHNESS, MAX_ROUGHNESS_PX = 0.05, 0.25
# Ratio of an ellipse's axes.
MAX_AXIS_RATIO = 8.0


class Blobs(NamedTuple):
    """Dark ellipses, the smoothest first.

    Attributes
    ----------
    centres : (N, 2) array
        In px.
    matrices : (N, 2, 2) array
        Symmetric; each maps the unit circle to the outline, px.
    """

    centres: Array
    matrices: Array


def find_blobs(gray: NDArray[np.uint8]) -> Blobs:
    """Find dark ellipses of any size in a gray image (H, W)."""
    import cv2

    scale = min(1.0, (MAX_SEARCH_PIXELS / max(gray.size, 1)) ** 0.5)
    if min(gray.shape) * scale < 8:
        return Blobs(np.zeros((0, 2)), np.zeros((0, 2, 2)))
    small = gray if scale == 1 else cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), 1.0)
    ellipses: list[tuple[float, Array, Array]] = []
    for share in WINDOW_SIDES:
        side = int(min(small.shape) * share) // 2 * 2 + 3
        dark = cv2.adaptiveThreshold(small, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, side, MIN_DARKNESS)
        outlines = cv2.findContours(dark, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)[0]
        outlines = [o for o in outlines if 2 * np.pi * MIN_RADIUS_PX <= len(o) <= 2 * max(small.shape)]
        if len(outlines) > MAX_OUTLINES:
            outlines = sorted(outlines, key=len, reverse=True)[:MAX_OUTLINES]
        ellipses += [ellipse for o in outlines if (ellipse := _ellipse(o)) is not None]
    ellipses.sort(key=lambda ellipse: ellipse[0])
    if not ellipses:
        return Blobs(np.zeros((0, 2)), np.zeros((0, 2, 2)))
    centres, matrices = np.array([e[1] for e in ellipses]), np.array([e[2] for e in ellipses])
    first = _distinct(centres, np.sqrt(np.linalg.det(matrices)))
    return Blobs((centres[first] + 0.5) / scale - 0.5, matrices[first] / scale)


def _ellipse(outline: NDArray[Any]) -> tuple[float, Array, Array] | None:
    """Return roughness, centroid and matrix of an outline (N, 1, 2); None if it is no ellipse."""
    import cv2

    hull = cv2.contourArea(cv2.convexHull(outline))
    if hull < np.pi * MIN_RADIUS_PX**2 or cv2.contourArea(outline) < MIN_CONVEXITY * hull:
        return None
    m = cv2.moments(outline)
    centre = np.array([m["m10"], m["m01"]]) / m["m00"]
    # The second moments of an ellipse are a quarter of its squared axes.
    variance, axes = np.linalg.eigh(np.array([[m["mu20"], m["mu11"]], [m["mu11"], m["mu02"]]]) / m["m00"])
    if variance[0] <= 0 or variance[1] > MAX_AXIS_RATIO**2 * variance[0]:
        return None
    radii = 2 * np.sqrt(variance)
    roughness = float(np.linalg.norm((outline[:, 0] - centre) @ axes / radii, axis=1).std())
    if roughness > MAX_ROUGHNESS + MAX_ROUGHNESS_PX / radii[0]:
        return None
    # The outline runs through the centres of pixels: half a pixel inside.
    return roughness, centre, axes * (radii + 0.5) @ axes.T


def _distinct(centres: Array, radii: Array) -> NDArray[np.int64]:
    """Return the blobs that do not repeat an earlier one of similar size and centre."""
    from scipy.spatial import KDTree  # imported on use: scipy is slow to import

    free = np.ones(len(centres), bool)
    for k, near in enumerate(KDTree(centres).query_ball_point(centres, radii / 2)):
        if free[k]:
            later = [other for other in near if other > k and 0.5 < radii[other] / radii[k] < 2]
            free[later] = False
    return np.flatnonzero(free)
