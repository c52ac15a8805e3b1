"""Compiled corners (J. Shi and C. Tomasi, Good features to track, CVPR 1994): the best one of each cell of an image."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver, njit_helper

# Half of the window of the structure tensor, as wide as a patch, and what a score needs around its pixel.
HALF, BORDER = 4, 5
# Distance to the next corner, px: patches that overlap more see the same.
MIN_DISTANCE_PX = 7


@njit_driver
def score_corners(gray, score, first, last):
    """Fill the rows first ... last of the smaller eigenvalue (H, W) of the structure tensor, 0 at the border.

    The tensor is the sum over the window of the products of the derivatives of an image (H, W) of 8 bits. Sums of
    columns follow from those of the row before; they are integers, so the result does not depend on the first row.
    """
    height, width = gray.shape
    sums = np.zeros((3, width), np.int32)
    begin, end = max(first, BORDER), min(last, height - BORDER)
    score[first:last] = np.float32(0.0)
    for row in range(begin - HALF, begin + HALF):
        _add_products(gray, row, np.int32(1), sums[0], sums[1], sums[2])
    for row in range(begin, end):
        _add_products(gray, row + HALF, np.int32(1), sums[0], sums[1], sums[2])
        _fill_eigenvalues(sums[0], sums[1], sums[2], score[row])
        _add_products(gray, row - HALF, np.int32(-1), sums[0], sums[1], sums[2])


@njit_helper
def _add_products(gray, row, sign, xx, xy, yy):
    """Add the products of eight times the derivatives (Sobel) in a row to sums (W,)."""
    above, here, below = gray[row - 1], gray[row], gray[row + 1]
    for x in range(1, len(here) - 1):
        a, b, c = np.int32(above[x - 1]), np.int32(above[x]), np.int32(above[x + 1])
        d, f = np.int32(here[x - 1]), np.int32(here[x + 1])
        g, h, i = np.int32(below[x - 1]), np.int32(below[x]), np.int32(below[x + 1])
        u = np.int32(c + 2 * f + i - a - 2 * d - g)
        v = np.int32(g + 2 * h + i - a - 2 * b - c)
        xx[x] = np.int32(xx[x] + sign * u * u)
        xy[x] = np.int32(xy[x] + sign * u * v)
        yy[x] = np.int32(yy[x] + sign * v * v)


@njit_helper
def _fill_eigenvalues(xx, xy, yy, score):
    """Fill the smaller eigenvalues of a row, from the sums of the products over the columns of the window."""
    half, scale = np.float32(0.5), np.float32(1.0 / 64.0)
    for x in range(BORDER, len(score) - BORDER):
        a, b, c = np.int32(0), np.int32(0), np.int32(0)
        for k in range(-HALF, HALF + 1):
            a, b, c = np.int32(a + xx[x + k]), np.int32(b + xy[x + k]), np.int32(c + yy[x + k])
        p, q, r = np.float32(a) * scale, np.float32(b) * scale, np.float32(c) * scale
        difference = half * (p - r)
        score[x] = half * (p + r) - np.sqrt(difference * difference + q * q)


@njit_driver
def best_corners(score, of_pixel, occupied, wanted, least, corners):
    """Fill the pixels (C, 2) of the best corner of each cell, -1 without any.

    Parameters
    ----------
    score
        (H, W).
    of_pixel
        (H, W) cell of each pixel, -1 where no corner is wanted.
    occupied
        (N, 2) pixels near which no corner is wanted.
    wanted
        (C,) whether a corner of a cell is wanted.
    least
        Score that a corner exceeds.
    corners
        Receives the result.
    """
    height, width = score.shape
    is_free = np.ones((height, width), np.bool_)
    for n in range(len(occupied)):
        x, y = int(np.rint(occupied[n, 0])), int(np.rint(occupied[n, 1]))
        top, left = max(y - MIN_DISTANCE_PX, 0), max(x - MIN_DISTANCE_PX, 0)
        is_free[top : max(y + MIN_DISTANCE_PX + 1, 0), left : max(x + MIN_DISTANCE_PX + 1, 0)] = False
    best = np.full(len(wanted), np.float32(least))
    corners[:] = -1
    for y in range(height):
        for x in range(width):
            cell = of_pixel[y, x]
            if cell < 0 or not wanted[cell] or score[y, x] <= best[cell]:
                continue
            if is_free[y, x] and _is_peak(score, x, y):
                best[cell] = score[y, x]
                corners[cell, 0], corners[cell, 1] = x, y


@njit_helper
def _is_peak(score, x, y):
    """Return whether no score is larger near a pixel."""
    height, width = score.shape
    value = score[y, x]
    if value < max(score[y, max(x - 1, 0)], score[y, min(x + 1, width - 1)]):
        return False
    for row in range(max(y - MIN_DISTANCE_PX, 0), min(y + MIN_DISTANCE_PX + 1, height)):
        for column in range(max(x - MIN_DISTANCE_PX, 0), min(x + MIN_DISTANCE_PX + 1, width)):
            if score[row, column] > value:
                return False
    return True
