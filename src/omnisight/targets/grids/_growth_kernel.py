"""The compiled part of `growth`."""

# Compiled code takes its types from its arguments.
# pyright: basic

import math

import numba
import numpy as np

_NEGATIVE = -0.3
"""Neighbours on a checkerboard are negatives of each other: their rings correlate below this."""

_FAINTER = 0.2
"""Of two neighbours the fainter has at least this part of the other's amplitude."""

_REACH = 0.3
"""How far from its predicted place the next corner is looked for, over the step to there."""

_CONE = 0.35
"""How far in radians off an edge of the seed its first neighbours may lie."""

_NEAR = (2.0, 160.0)
"""Least and most distance of the seed's first neighbours, px: a board of larger squares is found at a coarser scale."""

_SPAN = 96
"""Rows and columns that a grid may have on each side of its seed."""


@numba.njit(cache=True, nogil=True)
def grow(pixels, rings, edges, amplitude, items, starts, wide, high, bucket, smallest):
    """Give the number of grids, and for each saddle point its grid (-1: none), row and column (N, 3)."""
    count = len(pixels)
    cells = np.full((count, 3), -1, np.int64)
    table = np.full((2 * _SPAN + 1, 2 * _SPAN + 1), -1, np.int64)
    queue = np.empty((table.size, 2), np.int64)
    rings = rings.astype(np.float32)
    space = (items, starts, wide, high, bucket)
    grids = 0
    for seed in range(count):
        if cells[seed, 0] >= 0:
            continue
        cells[seed, 0] = grids
        table[_SPAN, _SPAN] = seed
        queue[0] = _SPAN, _SPAN
        tail = _first_cells(seed, pixels, rings, edges, amplitude, space, cells, grids, table, queue)
        head = 0
        while head < tail:
            i, j = queue[head]
            head += 1
            here = table[i, j]
            if not (2 < i < 2 * _SPAN - 2 and 2 < j < 2 * _SPAN - 2):
                continue
            for di, dj in ((0, 1), (1, 0), (0, -1), (-1, 0)):
                if table[i + di, j + dj] >= 0:
                    continue
                known, u, v = _predict(pixels, table, i, j, di, dj)
                if not known:
                    continue
                reach = _REACH * math.hypot(u - pixels[here, 0], v - pixels[here, 1])
                found = _nearest(u, v, reach, here, pixels, rings, amplitude, space, cells)
                if found >= 0:
                    table[i + di, j + dj] = found
                    cells[found, 0] = grids
                    queue[tail] = i + di, j + dj
                    tail += 1
        for k in range(tail):
            i, j = queue[k]
            member = table[i, j]
            table[i, j] = -1
            if tail >= smallest:
                cells[member, 1], cells[member, 2] = i, j
            else:
                cells[member, 0] = -1
        if tail >= smallest:
            grids += 1
    return grids, cells


@numba.njit(cache=True, nogil=True)
def _negatives(a, b, rings, amplitude):
    """Say whether two saddle points may be neighbours by what surrounds them."""
    fainter, stronger = min(amplitude[a], amplitude[b]), max(amplitude[a], amplitude[b])
    if fainter < _FAINTER * stronger:
        return False
    total = np.float32(0.0)
    for k in range(rings.shape[1]):
        total += rings[a, k] * rings[b, k]
    return total < _NEGATIVE


@numba.njit(cache=True, nogil=True)
def _nearest(u, v, reach, here, pixels, rings, amplitude, space, cells):
    """Give the free saddle point nearest to a place that may be a neighbour of `here`; -1 if none is within reach."""
    items, starts, wide, high, bucket = space
    best, least = -1, reach * reach
    for y in range(max(int((v - reach) // bucket), 0), min(int((v + reach) // bucket), high - 1) + 1):
        for x in range(max(int((u - reach) // bucket), 0), min(int((u + reach) // bucket), wide - 1) + 1):
            for k in range(starts[y * wide + x], starts[y * wide + x + 1]):
                other = items[k]
                away = (pixels[other, 0] - u) ** 2 + (pixels[other, 1] - v) ** 2
                if away < least and cells[other, 0] < 0 and _negatives(here, other, rings, amplitude):
                    best, least = other, away
    return best


@numba.njit(cache=True, nogil=True)
def _first_cells(seed, pixels, rings, edges, amplitude, space, cells, grid, table, queue):
    """Give the seed's nearest negatives along both its edges the cells around it; the length of the queue then."""
    items, starts, wide, high, bucket = space
    u, v = pixels[seed, 0], pixels[seed, 1]
    best = np.full(4, -1, np.int64)
    least = np.full(4, _NEAR[1])
    for y in range(max(int((v - _NEAR[1]) // bucket), 0), min(int((v + _NEAR[1]) // bucket), high - 1) + 1):
        for x in range(max(int((u - _NEAR[1]) // bucket), 0), min(int((u + _NEAR[1]) // bucket), wide - 1) + 1):
            for k in range(starts[y * wide + x], starts[y * wide + x + 1]):
                other = items[k]
                du, dv = pixels[other, 0] - u, pixels[other, 1] - v
                distance = math.hypot(du, dv)
                if cells[other, 0] >= 0 or distance <= _NEAR[0]:
                    continue
                bearing = math.atan2(dv, du)
                for side in range(4):
                    off = (bearing - edges[seed, side // 2] - (side % 2) * math.pi + math.pi) % (2 * math.pi) - math.pi
                    if abs(off) < _CONE and distance < least[side] and _negatives(seed, other, rings, amplitude):
                        best[side], least[side] = other, distance
    tail = 1
    for side in range(4):
        if best[side] >= 0 and cells[best[side], 0] < 0:
            sign = 1 - 2 * (side % 2)
            i, j = _SPAN + sign * (side // 2), _SPAN + sign * (1 - side // 2)
            table[i, j] = best[side]
            cells[best[side], 0] = grid
            queue[tail] = i, j
            tail += 1
    return tail


@numba.njit(cache=True, nogil=True)
def _predict(pixels, table, i, j, di, dj):
    """Guess where the next corner is: continue this line, or copy the step from the lines beside it."""
    here = pixels[table[i, j]]
    behind = table[i - di, j - dj]
    if behind >= 0:
        further = table[i - 2 * di, j - 2 * dj]
        u, v = 2 * here[0] - pixels[behind, 0], 2 * here[1] - pixels[behind, 1]
        if further >= 0:
            u += here[0] - 2 * pixels[behind, 0] + pixels[further, 0]
            v += here[1] - 2 * pixels[behind, 1] + pixels[further, 1]
        return True, u, v
    for side in (1, -1):
        a, b = table[i + side * dj, j + side * di], table[i + side * dj + di, j + side * di + dj]
        if a >= 0 and b >= 0:
            return True, here[0] + pixels[b, 0] - pixels[a, 0], here[1] + pixels[b, 1] - pixels[a, 1]
    return False, 0.0, 0.0
