"""Finds checkerboards of unknown size: saddle points of the brightness, joined into grids.

After A. Geiger, F. Moosmann, O. Car, B. Schuster: Automatic camera and range sensor calibration using a
single shot (ICRA 2012): a board is grown from a seed by local prediction, so a lens may bend it as it likes.
Here neighbours must also be negatives of each other, as two corners on one edge of a checkerboard are.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from .lattice import Lattice
from .sampling import bilinear

Cells = dict[tuple[int, int], int]
"""(row, column) of a growing grid, counted from its seed, to the index of the saddle point there."""

_SIGMA = 1.2
"""Smoothing in px before derivatives are taken."""

_RADIUS = 4.0
_SAMPLES = 32
"""Radius in px and number of samples of the ring around a saddle point."""

_STRONGEST = 3000
"""How many saddle points are kept, the strongest first."""

_FAINTEST = 3.0
"""Amplitude in gray levels around a saddle point below which it is noise."""

_NEGATIVE = -0.3
"""Neighbours on a checkerboard are negatives of each other: their rings correlate below this."""

_REACH = 0.3
"""How far from its predicted place the next corner is looked for, over the step to there."""

_CONE = 0.35
"""How far in radians off an edge of the seed its first neighbours may lie."""


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
    """

    pixels: NDArray[np.float64]
    rings: NDArray[np.float64]
    edges: NDArray[np.float64]


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
    return Saddles(pixels[good], ring, edges)


def grow_lattices(saddles: Saddles, smallest: int = 9) -> Iterator[Lattice]:
    """Join saddle points into grids; yield those of at least `smallest` corners, NaN where one is missing."""
    if len(saddles.pixels) < smallest:
        return
    tree = KDTree(saddles.pixels)
    free = np.ones(len(saddles.pixels), bool)
    for seed in range(len(saddles.pixels)):
        if not free[seed]:
            continue
        cells = _grow(saddles, tree, free, seed)
        if len(cells) >= smallest:
            free[list(cells.values())] = False
            yield _as_lattice(saddles, cells)


def _grow(saddles: Saddles, tree: Any, free: NDArray[np.bool_], seed: int) -> Cells:
    pixels = saddles.pixels
    cells = _first_cells(saddles, tree, free, seed)
    taken = set(cells.values())
    queue = deque(cells)
    while queue:
        i, j = queue.popleft()
        here = cells[i, j]
        for di, dj in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            guess = None if (i + di, j + dj) in cells else _predict(pixels, cells, i, j, di, dj)
            if guess is None:
                continue
            reach = _REACH * float(np.linalg.norm(guess - pixels[here]))
            near = [k for k in tree.query_ball_point(guess, reach) if free[k] and k not in taken]
            near = [k for k in near if saddles.rings[k] @ saddles.rings[here] < _NEGATIVE]
            if near:
                nearest = near[int(np.argmin(np.linalg.norm(pixels[near] - guess, axis=1)))]
                cells[i + di, j + dj] = nearest
                taken.add(nearest)
                queue.append((i + di, j + dj))
    return cells


def _first_cells(saddles: Saddles, tree: Any, free: NDArray[np.bool_], seed: int) -> Cells:
    """Give the seed the cell (0, 0) and its nearest negatives along both edges the cells around it."""
    centre, ring = saddles.pixels[seed], saddles.rings[seed]
    distance, near = tree.query(centre, k=min(40, len(saddles.pixels)))
    near = near[(distance > 2) & free[near]]
    near = near[saddles.rings[near] @ ring < _NEGATIVE]
    toward = saddles.pixels[near] - centre
    bearing = np.arctan2(toward[:, 1], toward[:, 0])
    cells = {(0, 0): seed}
    for edge, (di, dj) in zip(saddles.edges[seed], ((0, 1), (1, 0)), strict=True):
        for sign, turn in ((1, 0.0), (-1, np.pi)):
            off = np.abs((bearing - edge - turn + np.pi) % (2 * np.pi) - np.pi)
            ahead = near[off < _CONE]
            if len(ahead):
                cells[sign * di, sign * dj] = int(ahead[0])
    return cells


def _predict(pixels: NDArray[np.float64], cells: Cells, i: int, j: int, di: int, dj: int) -> NDArray[np.float64] | None:
    """Guess the next corner: continue this line, or copy the step from the lines beside it."""
    here = pixels[cells[i, j]]
    behind = cells.get((i - di, j - dj))
    if behind is not None:
        further = cells.get((i - 2 * di, j - 2 * dj))
        step = here - pixels[behind]
        bend = 0.0 if further is None else step - (pixels[behind] - pixels[further])
        return here + step + bend
    for side in (1, -1):
        beside = (i + side * dj, j + side * di)
        a, b = cells.get(beside), cells.get((beside[0] + di, beside[1] + dj))
        if a is not None and b is not None:
            return here + pixels[b] - pixels[a]
    return None


def _as_lattice(saddles: Saddles, cells: Cells) -> Lattice:
    where = np.array(list(cells))
    where -= where.min(axis=0)
    lattice = np.full((*(where.max(axis=0) + 1), 2), np.nan)
    lattice[where[:, 0], where[:, 1]] = saddles.pixels[list(cells.values())]
    return lattice
