"""Compiled part of `growth`: grow lattices of saddle points from seeds by local prediction."""

# Compiled code takes its types from its arguments.
# pyright: basic

import math
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from omnisight.compiled import STREAMLINED, njit_driver, njit_helper

# Neighbours on a checkerboard are negatives of each other: the correlation of their rings is below this.
MAX_RING_CORRELATION = -0.3
# Contrast across the edge between two neighbours over the fainter one's amplitude: without a square's edge, about 0.
MIN_EDGE_CONTRAST = 0.3
# Ratio of the amplitudes of two neighbours at least.
MIN_AMPLITUDE_RATIO = 0.2
# Distance of the next corner from its prediction, over the step to it.
SEARCH_RADIUS_STEPS = 0.3
# Angle, rad, between an edge of the seed and the direction to its first neighbours: opposite cones do not touch.
MAX_SEED_ANGLE_RAD = 0.35
# Distance, px, of the seed's first neighbours: a board of larger squares is found at a coarser scale.
MIN_STEP_PX, MAX_STEP_PX = 2.0, 100.0
# Ratio of two opposite steps of a seed inside a board.
MAX_STEP_RATIO = 1.6
# Middle part of the edge between two neighbours that is sampled, and px between samples.
EDGE_SHARE, EDGE_SAMPLING_PX = 0.6, 3.0
# Rows and columns of a lattice on each side of its seed at most.
MAX_SPAN = 96


class Points(NamedTuple):
    """Saddle points, the smoothed image, and the cells that are assigned to the points so far."""

    smooth: Any
    pixels: Any
    rings: Any
    edges: Any
    amplitude: Any
    cells: Any
    best: Any
    min_distance: Any


class Buckets(NamedTuple):
    """Points sorted into square buckets: `items[starts[b] : starts[b + 1]]` are in bucket b."""

    items: Any
    starts: Any
    columns: Any
    rows: Any
    side: Any


def grow(saddles, buckets, min_corners):
    """Return the number of lattices and, per saddle point, its lattice (-1: none), row and column (N, 3)."""
    cells = np.full((len(saddles.pixels), 3), -1, np.int64)
    points = Points(
        saddles.smooth,
        saddles.pixels,
        saddles.rings.astype(np.float32),
        saddles.edges,
        saddles.amplitude,
        cells,
        np.empty(4, np.int64),
        np.empty(4),
    )
    table = np.full((2 * MAX_SPAN + 1, 2 * MAX_SPAN + 1), -1, np.int64)
    queue = np.empty((table.size, 2), np.int64)
    count = _grow(points, buckets, table, queue, np.zeros(len(cells), np.bool_), min_corners)
    return count, cells


# Memory comes from Python: its allocation and reference counts take numba as long to compile as the rest.
@partial(njit_driver, **STREAMLINED)
def _grow(points, grid, table, queue, isolated, min_corners):
    """Fill the cells of the points, and return the number of lattices."""
    pixels, cells, count = points.pixels, points.cells, len(points.pixels)
    lattices = np.int64(0)
    # Seeds inside a board first: the first neighbours of another seed may belong to another board, or to none, and
    # would be taken away from it.
    for turn in range(2 * count):
        seed, inside_only = turn % count, turn < count
        if cells[seed, 0] >= 0 or isolated[seed]:
            continue
        size = _seed_cells(seed, points, grid, lattices, table, queue)
        isolated[seed] = size < 3  # with one neighbour at most it grows but a line
        if not inside_only or _is_inside(seed, pixels, table):
            size = _extend(size, points, grid, lattices, table, queue)
        accepted = size >= min_corners
        for k in range(size):
            i, j = queue[k, 0], queue[k, 1]
            member = table[i, j]
            table[i, j] = -1
            if accepted:
                cells[member, 1], cells[member, 2] = i, j
            else:
                cells[member, 0] = -1
        lattices += accepted
    return lattices


@njit_helper
def _extend(size, points, buckets, lattice, table, queue):
    """Extend a lattice cell by cell while a neighbour is found near its prediction; return its number of cells."""
    pixels = points.pixels
    head = 0
    while head < size:
        i, j = queue[head, 0], queue[head, 1]
        head += 1
        here = table[i, j]
        if not (2 < i < 2 * MAX_SPAN - 2 and 2 < j < 2 * MAX_SPAN - 2):
            continue
        for di, dj in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            if table[i + di, j + dj] >= 0:
                continue
            known, u, v = _predict(pixels, table, i, j, di, dj)
            if not known:
                continue
            radius = SEARCH_RADIUS_STEPS * math.hypot(u - pixels[here, 0], v - pixels[here, 1])
            nearest = _nearest_neighbour(u, v, radius, here, points, buckets)
            if nearest >= 0:
                table[i + di, j + dj] = nearest
                points.cells[nearest, 0] = lattice
                queue[size, 0], queue[size, 1] = i + di, j + dj
                size += 1
    return size


@njit_helper
def _is_inside(seed, pixels, table):
    """Return whether a seed has all four neighbours, in two lines of nearly equal steps."""
    for i, j in ((0, 1), (1, 0)):
        a, b = table[MAX_SPAN + i, MAX_SPAN + j], table[MAX_SPAN - i, MAX_SPAN - j]
        if a < 0 or b < 0:
            return False
        ahead = math.hypot(pixels[a, 0] - pixels[seed, 0], pixels[a, 1] - pixels[seed, 1])
        behind = math.hypot(pixels[b, 0] - pixels[seed, 0], pixels[b, 1] - pixels[seed, 1])
        if max(ahead, behind) > MAX_STEP_RATIO * min(ahead, behind):
            return False
    return True


@njit_helper
def _may_be_neighbours(a, b, points):
    """Return whether the rings of two saddle points are negatives, and one edge runs all the way between them."""
    smooth, pixels, rings, amplitude = points.smooth, points.pixels, points.rings, points.amplitude
    fainter, stronger = min(amplitude[a], amplitude[b]), max(amplitude[a], amplitude[b])
    if fainter < MIN_AMPLITUDE_RATIO * stronger:
        return False
    correlation = np.float32(0.0)
    for k in range(rings.shape[1]):
        correlation += rings[a, k] * rings[b, k]
    if correlation >= MAX_RING_CORRELATION:
        return False
    # Two corners that are no neighbours may be negatives of each other, but there are squares between them.
    du, dv = pixels[b, 0] - pixels[a, 0], pixels[b, 1] - pixels[a, 1]
    length = math.hypot(du, dv)
    aside = max(1.5, 0.15 * length) / length
    samples = max(1, int(EDGE_SHARE * length / EDGE_SAMPLING_PX))
    sign = 0.0
    for k in range(samples):
        s = 0.5 + EDGE_SHARE * ((k + 0.5) / samples - 0.5)
        u, v = pixels[a, 0] + s * du, pixels[a, 1] + s * dv
        across = _pixel(smooth, u - aside * dv, v + aside * du) - _pixel(smooth, u + aside * dv, v - aside * du)
        if across * sign < 0.0 or abs(across) < MIN_EDGE_CONTRAST * fainter:
            return False
        sign = across
    return True


@njit_helper
def _pixel(image, u, v):
    """Return the value of the nearest pixel."""
    return image[min(max(round(v), 0), image.shape[0] - 1), min(max(round(u), 0), image.shape[1] - 1)]


@njit_helper
def _bucket_range(centre, radius, buckets, count):
    """Return the first bucket within a radius along one axis, and one past the last."""
    return max(int((centre - radius) // buckets.side), 0), min(int((centre + radius) // buckets.side), count - 1) + 1


@njit_helper
def _nearest_neighbour(u, v, radius, here, points, buckets):
    """Return the free saddle point nearest to (u, v) that may be a neighbour of `here`; -1 if none is in range."""
    pixels = points.pixels
    best, min_square = -1, radius * radius
    left, right = _bucket_range(u, radius, buckets, buckets.columns)
    top, bottom = _bucket_range(v, radius, buckets, buckets.rows)
    for y in range(top, bottom):
        for x in range(left, right):
            bucket = y * buckets.columns + x
            for k in range(buckets.starts[bucket], buckets.starts[bucket + 1]):
                other = buckets.items[k]
                square = (pixels[other, 0] - u) ** 2 + (pixels[other, 1] - v) ** 2
                if square < min_square and points.cells[other, 0] < 0 and _may_be_neighbours(here, other, points):
                    best, min_square = other, square
    return best


@njit_helper
def _seed_cells(seed, points, buckets, lattice, table, queue):
    """Start a lattice with a seed and its nearest neighbours along both its edges; return the number of cells."""
    points.cells[seed, 0] = lattice
    table[MAX_SPAN, MAX_SPAN] = seed
    queue[0, 0] = queue[0, 1] = MAX_SPAN
    _find_first_neighbours(seed, points, buckets)
    best = points.best
    size = 1
    for side in range(4):
        if best[side] >= 0 and points.cells[best[side], 0] < 0:
            sign = 1 - 2 * (side % 2)
            i, j = MAX_SPAN + sign * (side // 2), MAX_SPAN + sign * (1 - side // 2)
            table[i, j] = best[side]
            points.cells[best[side], 0] = lattice
            queue[size, 0], queue[size, 1] = i, j
            size += 1
    return size


@njit_helper
def _find_first_neighbours(seed, points, buckets):
    """Set `best` to the nearest possible neighbours of a seed in the four directions of its edges; -1 for none."""
    pixels, edges, best, min_distance = points.pixels, points.edges, points.best, points.min_distance
    u, v = pixels[seed, 0], pixels[seed, 1]
    for side in range(4):
        best[side], min_distance[side] = -1, MAX_STEP_PX
    left, right = _bucket_range(u, MAX_STEP_PX, buckets, buckets.columns)
    top, bottom = _bucket_range(v, MAX_STEP_PX, buckets, buckets.rows)
    for y in range(top, bottom):
        for x in range(left, right):
            bucket = y * buckets.columns + x
            for k in range(buckets.starts[bucket], buckets.starts[bucket + 1]):
                other = buckets.items[k]
                du, dv = pixels[other, 0] - u, pixels[other, 1] - v
                distance = math.hypot(du, dv)
                if points.cells[other, 0] >= 0 or distance <= MIN_STEP_PX:
                    continue
                direction = math.atan2(dv, du)
                for side in range(4):
                    off = direction - edges[seed, side // 2] - (side % 2) * math.pi
                    off = (off + math.pi) % (2 * math.pi) - math.pi
                    if abs(off) >= MAX_SEED_ANGLE_RAD or distance >= min_distance[side]:
                        continue
                    if _may_be_neighbours(seed, other, points):
                        best[side], min_distance[side] = other, distance


@njit_helper
def _predict(pixels, table, i, j, di, dj):
    """Predict the next corner: extrapolate this line, or copy the step from the line beside it."""
    here, behind = table[i, j], table[i - di, j - dj]
    here_u, here_v = pixels[here, 0], pixels[here, 1]
    if behind >= 0:
        further = table[i - 2 * di, j - 2 * dj]
        u, v = 2 * here_u - pixels[behind, 0], 2 * here_v - pixels[behind, 1]
        if further >= 0:
            u += here_u - 2 * pixels[behind, 0] + pixels[further, 0]
            v += here_v - 2 * pixels[behind, 1] + pixels[further, 1]
        return True, u, v
    for side in (1, -1):
        a, b = table[i + side * dj, j + side * di], table[i + side * dj + di, j + side * di + dj]
        if a >= 0 and b >= 0:
            return True, here_u + pixels[b, 0] - pixels[a, 0], here_v + pixels[b, 1] - pixels[a, 1]
    return False, 0.0, 0.0
