"""The compiled part of `growth`."""

# Compiled code takes its types from its arguments.
# pyright: basic

import math

import numpy as np

from omnisight.compiled import inner, outer

_NEGATIVE = -0.3
"""Neighbours on a checkerboard are negatives of each other: their rings correlate below this."""

_EDGE = 0.3
"""Contrast across the edge between two neighbours, over the fainter one's amplitude, below which there is none."""

_FAINTER = 0.2
"""Of two neighbours the fainter has at least this part of the other's amplitude."""

_REACH = 0.3
"""How far from its predicted place the next corner is looked for, over the step to there."""

_CONE = 0.35
"""How far in radians off an edge of the seed its first neighbours may lie."""

_NEAR = (2.0, 100.0)
"""Least and most distance of the seed's first neighbours, px: a board of larger squares is found at a coarser scale."""

_UNEVEN = 1.6
"""How much longer one of two opposite steps of a seed amid a board may be."""

_CLEAR, _SPACING = 0.6, 3.0
"""Part of the edge between two neighbours that is looked at, amid it, and px from one look to the next."""

_SPAN = 96
"""Rows and columns that a grid may have on each side of its seed."""


@outer
def grow(smooth, pixels, rings, edges, amplitude, space, smallest):
    """Give the number of grids, and for each saddle point its grid (-1: none), row and column (N, 3)."""
    count = len(pixels)
    cells = np.full((count, 3), -1, np.int64)
    table = np.full((2 * _SPAN + 1, 2 * _SPAN + 1), -1, np.int64)
    queue = np.empty((table.size, 2), np.int64)
    lone = np.zeros(count, np.bool_)
    rings = rings.astype(np.float32)
    grids = 0
    # Seeds amid a board first: another's first neighbours may be another board's, or none, and it would take them away.
    for turn in range(2 * count):
        seed, amid = turn % count, turn < count
        if cells[seed, 0] >= 0 or lone[seed]:
            continue
        cells[seed, 0] = grids
        table[_SPAN, _SPAN] = seed
        queue[0, 0] = queue[0, 1] = _SPAN
        tail = _first_cells(seed, smooth, pixels, rings, edges, amplitude, space, cells, grids, table, queue)
        lone[seed] = tail < 3  # with one neighbour at most, and later no more: it grows but a line
        head = 0
        if amid and not _amid(seed, pixels, table):
            head = tail  # not yet
        while head < tail:
            i, j = queue[head, 0], queue[head, 1]
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
                found = _nearest(u, v, reach, here, smooth, pixels, rings, amplitude, space, cells)
                if found >= 0:
                    table[i + di, j + dj] = found
                    cells[found, 0] = grids
                    queue[tail, 0], queue[tail, 1] = i + di, j + dj
                    tail += 1
        for k in range(tail):
            i, j = queue[k, 0], queue[k, 1]
            member = table[i, j]
            table[i, j] = -1
            if tail >= smallest:
                cells[member, 1], cells[member, 2] = i, j
            else:
                cells[member, 0] = -1
        if tail >= smallest:
            grids += 1
    return grids, cells


@inner
def _amid(seed, pixels, table):
    """Say whether a seed's first cells are four, in two lines of nearly equal steps."""
    for i, j in ((0, 1), (1, 0)):
        a, b = table[_SPAN + i, _SPAN + j], table[_SPAN - i, _SPAN - j]
        if a < 0 or b < 0:
            return False
        ahead = math.hypot(pixels[a, 0] - pixels[seed, 0], pixels[a, 1] - pixels[seed, 1])
        behind = math.hypot(pixels[b, 0] - pixels[seed, 0], pixels[b, 1] - pixels[seed, 1])
        if max(ahead, behind) > _UNEVEN * min(ahead, behind):
            return False
    return True


@inner
def _neighbours(a, b, smooth, pixels, rings, amplitude):
    """Say whether two saddle points may be neighbours by what surrounds them and by the edge between them."""
    fainter, stronger = min(amplitude[a], amplitude[b]), max(amplitude[a], amplitude[b])
    if fainter < _FAINTER * stronger:
        return False
    total = np.float32(0.0)
    for k in range(rings.shape[1]):
        total += rings[a, k] * rings[b, k]
    if total >= _NEGATIVE:
        return False
    # Bright on one side and dark on the other all the way: two corners of a board that are no neighbours may well be
    # negatives of each other, but there are squares between them.
    du, dv = pixels[b, 0] - pixels[a, 0], pixels[b, 1] - pixels[a, 1]
    length = math.hypot(du, dv)
    aside = max(1.5, 0.15 * length) / length
    samples = max(1, int(_CLEAR * length / _SPACING))
    sign = 0.0
    for k in range(samples):
        s = 0.5 + _CLEAR * ((k + 0.5) / samples - 0.5)
        u, v = pixels[a, 0] + s * du, pixels[a, 1] + s * dv
        across = _at(smooth, u - aside * dv, v + aside * du) - _at(smooth, u + aside * dv, v - aside * du)
        if across * sign < 0.0 or abs(across) < _EDGE * fainter:
            return False
        sign = across
    return True


@inner
def _at(image, u, v):
    """Give the pixel nearest to a place."""
    return image[min(max(round(v), 0), image.shape[0] - 1), min(max(round(u), 0), image.shape[1] - 1)]


@inner
def _nearest(u, v, reach, here, smooth, pixels, rings, amplitude, space, cells):
    """Give the free saddle point nearest to a place that may be a neighbour of `here`; -1 if none is within reach."""
    items, starts, wide, high, bucket = space
    best, least = -1, reach * reach
    for y in range(max(int((v - reach) // bucket), 0), min(int((v + reach) // bucket), high - 1) + 1):
        for x in range(max(int((u - reach) // bucket), 0), min(int((u + reach) // bucket), wide - 1) + 1):
            for k in range(starts[y * wide + x], starts[y * wide + x + 1]):
                other = items[k]
                away = (pixels[other, 0] - u) ** 2 + (pixels[other, 1] - v) ** 2
                if away < least and cells[other, 0] < 0 and _neighbours(here, other, smooth, pixels, rings, amplitude):
                    best, least = other, away
    return best


@inner
def _first_cells(seed, smooth, pixels, rings, edges, amplitude, space, cells, grid, table, queue):
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
                    if abs(off) >= _CONE or distance >= least[side]:
                        continue
                    if _neighbours(seed, other, smooth, pixels, rings, amplitude):
                        best[side], least[side] = other, distance
    tail = 1
    for side in range(4):
        if best[side] >= 0 and cells[best[side], 0] < 0:
            sign = 1 - 2 * (side % 2)
            i, j = _SPAN + sign * (side // 2), _SPAN + sign * (1 - side // 2)
            table[i, j] = best[side]
            cells[best[side], 0] = grid
            queue[tail, 0], queue[tail, 1] = i, j
            tail += 1
    return tail


@inner
def _predict(pixels, table, i, j, di, dj):
    """Guess where the next corner is: continue this line, or copy the step from the lines beside it."""
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
