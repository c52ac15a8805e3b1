"""Edges of a picture as chains of sub-pixel points.

An edge point is where the gradient is largest across the edge, to a fraction of a pixel by a parabola through three
samples (Devernay, A non-maxima suppression method for edge detection with sub-pixel accuracy, INRIA RR-2724, 1995);
points are linked to the nearest one ahead that agrees, if that one agrees too (Grompone von Gioi and Randall, A
sub-pixel edge detector, IPOL 2017).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BLUR = 1.2  # px
FAINT, CLEAR = 1.2, 4.0  # gray levels per px: a point, and the median of a chain
ALIKE = 0.8  # cosine between the gradients of points that are linked
REACH = 2  # px to the next point, per axis


def edge_chains(
    gray: NDArray[np.uint8], visible: NDArray[np.bool_] | None = None, *, least_length: int = 20
) -> list[Array]:
    """Trace the edges of a picture.

    Parameters
    ----------
    gray
        (H, W) uint8.
    visible
        (H, W), where to look; everywhere unless given. An edge of what is visible is no edge of the picture: give it
        with a margin.
    least_length
        Points of the shortest chain.

    Returns
    -------
    Chains of pixels (n, 2), each ordered along its edge, dark on the same side all along. A closed edge is cut open.

    Raises
    ------
    ValueError
        If the picture is not gray and of 8 bits, or the two differ in size.
    """
    if gray.ndim != 2 or gray.dtype != np.uint8:
        raise ValueError(f"expected a gray picture (H, W) of uint8, got {gray.dtype} of shape {gray.shape}")
    if visible is not None and visible.shape != gray.shape:
        raise ValueError(f"the picture has shape {gray.shape}, what is visible of it {visible.shape}")
    if min(gray.shape) < 8:
        return []
    pixels, gradients, index = _edge_points(gray, visible)
    ahead = _links(pixels, gradients, index)
    strength = np.linalg.norm(gradients, axis=1)
    long = (chain for chain in _followed(ahead) if len(chain) >= least_length)
    return [pixels[chain] for chain in long if np.median(strength[chain]) >= CLEAR]


def _edge_points(gray: NDArray[np.uint8], visible: NDArray[np.bool_] | None) -> tuple[Array, Array, NDArray[np.int64]]:
    """Give edge points (N, 2), their gradients (N, 2), and the point of each pixel (H, W), -1 where there is none."""
    import cv2

    soft = cv2.GaussianBlur(gray.astype(np.float32), (0, 0), BLUR)
    gu, gv = (np.asarray(cv2.Sobel(soft, cv2.CV_32F, *order, scale=1 / 8)) for order in ((1, 0), (0, 1)))
    strength = np.hypot(gu, gv)
    strong = strength > FAINT
    strong[[0, 1, -2, -1]], strong[:, [0, 1, -2, -1]] = False, False
    if visible is not None:
        strong &= visible
    row, column = np.nonzero(strong)
    # Across the edge along a row or along a column, whichever is nearer to the gradient.
    flat = np.abs(gu[row, column]) < np.abs(gv[row, column])
    down, right = np.where(flat, 1, 0), np.where(flat, 0, 1)
    at = strength[row, column]
    before, after = strength[row - down, column - right], strength[row + down, column + right]
    top = (at > before) & (at >= after)
    row, column, down, right, before, at, after = (a[top] for a in (row, column, down, right, before, at, after))
    shift = 0.5 * (before - after) / np.minimum(before - 2 * at + after, -1e-6)
    pixels = np.stack([column + shift * right, row + shift * down], -1).astype(np.float64)
    index = np.full(gray.shape, -1, np.int64)
    index[row, column] = np.arange(len(row))
    return pixels, np.stack([gu[row, column], gv[row, column]], -1).astype(np.float64), index


def _links(pixels: Array, gradients: Array, index: NDArray[np.int64]) -> NDArray[np.int64]:
    """Give the point ahead of each (N,), -1 where the chain ends: the nearest on both sides."""
    count = len(pixels)
    unit = gradients / np.maximum(np.linalg.norm(gradients, axis=1), 1e-9)[:, None]
    tangent = np.stack([-unit[:, 1], unit[:, 0]], -1)
    row, column = np.nonzero(index >= 0)
    here = index[row, column]
    ahead, behind = np.full(count, -1), np.full(count, -1)
    far_ahead, far_behind = np.full(count, np.inf), np.full(count, np.inf)
    padded = np.pad(index, REACH, constant_values=-1)
    steps = range(-REACH, REACH + 1)
    for dv, du in ((dv, du) for dv in steps for du in steps if (dv, du) != (0, 0)):
        other = padded[row + dv + REACH, column + du + REACH]
        a, b = here[other >= 0], other[other >= 0]
        step = pixels[b] - pixels[a]
        length = np.linalg.norm(step, axis=1)
        forward = (step * (tangent[a] + tangent[b])).sum(1)
        fits = ((unit[a] * unit[b]).sum(1) > ALIKE) & (np.abs(forward) > 1.2 * length)
        for way, best, far in ((1, ahead, far_ahead), (-1, behind, far_behind)):
            use = fits & (way * forward > 0) & (length < far[a])
            best[a[use]], far[a[use]] = b[use], length[use]
    mutual = (ahead >= 0) & (behind[ahead] == np.arange(count))
    return np.where(mutual, ahead, -1)


def _followed(ahead: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Give the chains of points that the links make: the open ones from their first point, then the closed ones."""
    links: list[int] = ahead.tolist()
    first = np.ones(len(links), np.bool_)
    first[ahead[ahead >= 0]] = False
    done = bytearray(len(links))
    chains: list[NDArray[np.int64]] = []
    for start in [*np.flatnonzero(first).tolist(), *range(len(links))]:
        chain: list[int] = []
        point = int(start)
        while point >= 0 and not done[point]:
            done[point] = 1
            chain.append(point)
            point = links[point]
        if len(chain) > 1:
            chains.append(np.array(chain))
    return chains
