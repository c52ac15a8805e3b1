"""Edges of an image as chains of sub-pixel points.

An edge point is the maximum of the gradient magnitude across the edge, located by a parabola through three samples
(Devernay, A non-maxima suppression method for edge detection with sub-pixel accuracy, INRIA RR-2724, 1995). Each point
is linked to the nearest consistent point ahead if the choice is mutual (Grompone von Gioi and Randall, A sub-pixel
edge detector, IPOL 2017).
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BLUR_SIGMA_PX = 1.2
# Gradient magnitudes in gray levels per px: smallest of an edge point, and smallest median along a chain (hysteresis).
MIN_POINT_GRADIENT, MIN_CHAIN_GRADIENT = 1.2, 4.0
# Smallest cosine between the gradients of linked points.
MIN_LINK_COSINE = 0.8
# Links reach this many pixels along each image axis.
LINK_REACH_PX = 2


def detect_edge_chains(
    gray: NDArray[np.uint8], mask: NDArray[np.bool_] | None = None, *, min_points: int = 20
) -> list[Array]:
    """Detect the edges of an image.

    Parameters
    ----------
    gray
        (H, W) uint8.
    mask
        (H, W), where to detect edges; everywhere by default. Erode a mask of the image field by a margin, since its
        boundary is an edge of the image.
    min_points
        Points of the shortest chain.

    Returns
    -------
    Chains of pixels (n, 2), each ordered along its edge with the dark side on the same hand. Closed edges are cut.

    Raises
    ------
    ValueError
        If the image is not 8-bit gray, or if the sizes of image and mask differ.
    """
    if gray.ndim != 2 or gray.dtype != np.uint8:
        raise ValueError(f"expected a gray image (H, W) of uint8, got {gray.dtype} of shape {gray.shape}")
    if mask is not None and mask.shape != gray.shape:
        raise ValueError(f"expected a mask of the image's shape {gray.shape}, got {mask.shape}")
    if min(gray.shape) < 8:
        return []
    pixels, gradients, index = _edge_points(gray, mask)
    successors = _successors(pixels, gradients, index)
    magnitude = np.linalg.norm(gradients, axis=1)
    chains = (chain for chain in _chains(successors) if len(chain) >= min_points)
    return [pixels[chain] for chain in chains if np.median(magnitude[chain]) >= MIN_CHAIN_GRADIENT]


def _edge_points(gray: NDArray[np.uint8], mask: NDArray[np.bool_] | None) -> tuple[Array, Array, NDArray[np.int64]]:
    """Return edge points (N, 2), their gradients (N, 2), and an index image (H, W) that is -1 where there is none."""
    import cv2

    smooth = cv2.GaussianBlur(gray.astype(np.float32), (0, 0), BLUR_SIGMA_PX)
    gu, gv = (np.asarray(cv2.Sobel(smooth, cv2.CV_32F, *order, scale=1 / 8)) for order in ((1, 0), (0, 1)))
    magnitude = np.hypot(gu, gv)
    candidates = magnitude > MIN_POINT_GRADIENT
    candidates[[0, 1, -2, -1]], candidates[:, [0, 1, -2, -1]] = False, False
    if mask is not None:
        candidates &= mask
    row, column = np.nonzero(candidates)
    # Search for the maximum along the image axis that is nearer to the gradient.
    vertical = np.abs(gu[row, column]) < np.abs(gv[row, column])
    down, right = np.where(vertical, 1, 0), np.where(vertical, 0, 1)
    at = magnitude[row, column]
    before, after = magnitude[row - down, column - right], magnitude[row + down, column + right]
    is_maximum = (at > before) & (at >= after)
    row, column, down, right, before, at, after = (a[is_maximum] for a in (row, column, down, right, before, at, after))
    shift = 0.5 * (before - after) / np.minimum(before - 2 * at + after, -1e-6)
    pixels = np.stack([column + shift * right, row + shift * down], -1).astype(np.float64)
    index = np.full(gray.shape, -1, np.int64)
    index[row, column] = np.arange(len(row))
    return pixels, np.stack([gu[row, column], gv[row, column]], -1).astype(np.float64), index


def _successors(pixels: Array, gradients: Array, index: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the next point along the edge (N,), -1 at the end of a chain; a link is the nearest on both sides."""
    count = len(pixels)
    normal = gradients / np.maximum(np.linalg.norm(gradients, axis=1), 1e-9)[:, None]
    tangent = np.stack([-normal[:, 1], normal[:, 0]], -1)
    row, column = np.nonzero(index >= 0)
    points = index[row, column]
    ahead, behind = np.full(count, -1), np.full(count, -1)
    distance_ahead, distance_behind = np.full(count, np.inf), np.full(count, np.inf)
    padded = np.pad(index, LINK_REACH_PX, constant_values=-1)
    steps = range(-LINK_REACH_PX, LINK_REACH_PX + 1)
    for dv, du in ((dv, du) for dv in steps for du in steps if (dv, du) != (0, 0)):
        neighbour = padded[row + dv + LINK_REACH_PX, column + du + LINK_REACH_PX]
        a, b = points[neighbour >= 0], neighbour[neighbour >= 0]
        step = pixels[b] - pixels[a]
        length = np.linalg.norm(step, axis=1)
        forward = (step * (tangent[a] + tangent[b])).sum(1)
        consistent = ((normal[a] * normal[b]).sum(1) > MIN_LINK_COSINE) & (np.abs(forward) > 1.2 * length)
        for sign, nearest, distance in ((1, ahead, distance_ahead), (-1, behind, distance_behind)):
            nearer = consistent & (sign * forward > 0) & (length < distance[a])
            nearest[a[nearer]], distance[a[nearer]] = b[nearer], length[nearer]
    mutual = (ahead >= 0) & (behind[ahead] == np.arange(count))
    return np.where(mutual, ahead, -1)


def _chains(successors: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Return the chains of linked points: open chains from their first point, then closed ones."""
    links: list[int] = successors.tolist()
    is_first = np.ones(len(links), np.bool_)
    is_first[successors[successors >= 0]] = False
    visited = bytearray(len(links))
    chains: list[NDArray[np.int64]] = []
    for start in [*np.flatnonzero(is_first).tolist(), *range(len(links))]:
        chain: list[int] = []
        point = int(start)
        while point >= 0 and not visited[point]:
            visited[point] = 1
            chain.append(point)
            point = links[point]
        if len(chain) > 1:
            chains.append(np.array(chain))
    return chains
