"""Compiled robust triangulation of tracks of different lengths."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver, njit_helper
from omnisight.twoview._small_vectors_kernel import cross, dot
from omnisight.twoview._triangulation_kernel import refine_point

# Pairs of rays from which a point is computed; all pairs of up to eight rays.
MAX_PAIRS = 28
# Rounds of the refinement of a point by its inliers.
ROUNDS = 2


@njit_driver
def triangulate_tracks(starts, image, origins, directions, axes, threshold, min_parallax, first, last, points, inliers):
    """Fill points (T, 3) and inliers (M,) of the tracks first ... last; a point is NaN if two rays do not agree.

    The point of the pair of rays with the least truncated sum of squared residuals (RANSAC over all pairs, or over an
    even selection of them) is refined by its inliers. Of several observations in one image the best is an inlier.

    Parameters
    ----------
    starts
        (T + 1,) first observation of each track.
    image
        (M,) indices; observations in one image are neighbours.
    origins, directions, axes
        (M, 3), (M, 3) and (M, 2, 3) of the rays in the world frame.
    threshold
        Squared length of a whitened residual that an inlier does not exceed.
    min_parallax
        Angle between the rays of a pair, radians.
    """
    for n in range(first, last):
        start, end = starts[n], starts[n + 1]
        points[n] = np.nan
        inliers[start:end] = False
        _best_pair(image, origins, directions, axes, threshold, min_parallax, start, end, points[n])
        if np.isnan(points[n, 0]):
            continue
        for _ in range(ROUNDS):
            _select(image, origins, directions, axes, threshold, start, end, points[n], inliers)
            chosen = np.flatnonzero(inliers[start:end]) + start
            if len(chosen) < 2:
                break
            refine_point(points[n], origins[chosen], directions[chosen], axes[chosen], np.zeros((3, 3)))
        _select(image, origins, directions, axes, threshold, start, end, points[n], inliers)
        if inliers[start:end].sum() < 2 or _largest_angle(directions, inliers, start, end) < min_parallax:
            points[n] = np.nan
            inliers[start:end] = False


@njit_driver
def divide_tracks(starts, frame, is_connected, track):
    """Fill the new track (M,) of each observation: the frames of a track are connected in pairs; return their number.

    Each observation joins the first part of its track whose frames are all connected with its own.

    Parameters
    ----------
    starts
        (T + 1,) first observation of each track.
    frame
        (M,) indices.
    is_connected
        (F, F) bool.
    """
    count = 0
    for n in range(len(starts) - 1):
        parts = 0
        for k in range(starts[n], starts[n + 1]):
            track[k] = count + parts
            for part in range(count, count + parts):
                fits = True
                for other in range(starts[n], k):
                    if track[other] == part and not is_connected[frame[k], frame[other]]:
                        fits = False
                        break
                if fits:
                    track[k] = part
                    break
            if track[k] == count + parts:
                parts += 1
        count += parts
    return count


@njit_helper
def _best_pair(image, origins, directions, axes, threshold, min_parallax, start, end, best):
    """Fill the point (3,) of the pair of rays that most observations agree with; it stays NaN without any."""
    count = end - start
    pairs = count * (count - 1) // 2
    step = max(1.0, pairs / MAX_PAIRS)
    least, point, number, following = threshold * count, np.empty(3), 0, 0.0
    for i in range(start, end):
        for j in range(i + 1, end):
            number += 1
            if number <= following:
                continue
            following += step
            if image[i] == image[j] or not _midpoint(origins, directions, i, j, min_parallax, point):
                continue
            score = 0.0
            for k in range(start, end):
                score += min(_square(origins[k], directions[k], axes[k], point), threshold)
            if score < least:
                least = score
                for c in range(3):
                    best[c] = point[c]


@njit_helper
def _midpoint(origins, directions, i, j, min_parallax, point):
    """Fill the midpoint (3,) of two rays; return whether it is in front of both, and their angle large enough."""
    a, b = directions[i], directions[j]
    normal = cross(a, b)
    square = dot(normal, normal)
    if square < max(min_parallax**2, 1e-14) and (dot(a, b) > 0.0 or square < 1e-14):
        return False
    apart = origins[j, 0] - origins[i, 0], origins[j, 1] - origins[i, 1], origins[j, 2] - origins[i, 2]
    along_a, along_b = dot(cross(apart, b), normal) / square, dot(cross(apart, a), normal) / square
    for c in range(3):
        point[c] = 0.5 * (origins[i, c] + along_a * a[c] + origins[j, c] + along_b * b[c])
    return along_a > 0.0 and along_b > 0.0


@njit_helper
def _square(origin, direction, axes, point):
    """Return the squared length of the whitened residual of a ray; inf if the point is behind it."""
    x, y, z = point[0] - origin[0], point[1] - origin[1], point[2] - origin[2]
    inverse = 1.0 / max(np.sqrt(x * x + y * y + z * z), 1e-300)
    u = x * inverse, y * inverse, z * inverse
    if dot(u, direction) <= 0.0:
        return np.inf
    return dot(axes[0], u) ** 2 + dot(axes[1], u) ** 2


@njit_helper
def _select(image, origins, directions, axes, threshold, start, end, point, inliers):
    """Fill which observations (M,) of a track agree with a point, at most one in each image."""
    last, best = -1, np.inf
    for k in range(start, end):
        square = _square(origins[k], directions[k], axes[k], point)
        inliers[k] = square <= threshold
        if not inliers[k]:
            continue
        if last >= 0 and image[last] == image[k]:
            if square >= best:
                inliers[k] = False
                continue
            inliers[last] = False
        last, best = k, square


@njit_helper
def _largest_angle(directions, inliers, start, end):
    """Return the largest angle between two rays of the inliers, radians."""
    least = 1.0
    for i in range(start, end):
        if inliers[i]:
            for j in range(i + 1, end):
                if inliers[j]:
                    least = min(least, dot(directions[i], directions[j]))
    return np.arccos(max(least, -1.0))
