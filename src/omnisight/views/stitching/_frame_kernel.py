"""Compiled part of `frame_stitcher`: sample, correct and blend the planes of all cameras in one pass."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver, njit_inlined
from omnisight.views._plane_kernel import UNCOVERED, interpolated

# Mark of a block of pixels that several cameras show.
MIXED = 255


@njit_inlined
def sampled(source, stride, index, fraction):
    """Return the interpolated value of a pixel of a packed map."""
    at = np.uint64(index)
    p = (at >> np.uint64(16)) * stride + (at & np.uint64(0xFFFF))
    return np.float32(interpolated(source, p, stride, fraction)) * np.float32(1 / 4096)


@njit_inlined
def correction_at(low, row, column, plane, rows, columns):
    """Return the correction (h, w, 3) of a plane at a block: bilinear, periodic along the row."""
    y = min(max((row + 0.5) * low.shape[0] / rows - 0.5, 0.0), low.shape[0] - 1.0)
    x = (column + 0.5) * low.shape[1] / columns - 0.5
    i, j = int(np.floor(x)), int(y)
    fx, fy = np.float32(x - i), np.float32(y - j)
    below = min(j + 1, low.shape[0] - 1)
    left, right = i % low.shape[1], (i + 1) % low.shape[1]
    upper = low[j, left, plane] + (low[j, right, plane] - low[j, left, plane]) * fx
    lower = low[below, left, plane] + (low[below, right, plane] - low[below, left, plane]) * fx
    return upper + (lower - upper) * fy


@njit_driver
def stitch_planes(sources, strides, luma, chroma, kind, colors, low, limits, first, last, planes):
    """Write rows first to last of the chroma planes of a sphere, and the luma rows of the same blocks of 2x2 pixels.

    Parameters
    ----------
    sources : tuple of arrays
        Luma and both chroma planes of each camera, flat.
    strides : (3 K,) array of uint64
        Pixels per row of each.
    luma, chroma : tuples of arrays
        Packed maps (K, H, W) and weights (K, H, W, 1/64) of luma; packed maps (K, h, w) and gains (K, h, w, 1/4096) of
        chroma.
    kind : (h, w) array of uint8
        The camera that shows the whole block alone, or MIXED.
    colors : (K, 3, 3) array of float32
        Matrix of each camera for (Y - black, U - gray, V - gray).
    low : (h / 4, w / 4, 3) array of float32
        Correction of the coarse bands.
    limits : (black, gray, largest)
        Values of luma and chroma.
    planes : tuple of arrays
        The planes of the sphere (H, S), (h, S), (h, S).
    """
    index, fraction, weight = luma
    chroma_index, chroma_fraction, gain = chroma
    black, gray, largest = limits
    count = kind.shape[1]
    total = np.zeros(4, np.float32)
    for row in range(first, last):
        for column in range(count):
            only = kind[row, column]
            start, end = (0, len(colors)) if only == MIXED else (only, only + 1)
            total[:] = 0
            u_sum = v_sum = np.float32(0)
            for k in range(start, end):
                packed_fraction = chroma_fraction[k, row, column]
                if packed_fraction & UNCOVERED:
                    continue
                g = np.float32(gain[k, row, column]) * np.float32(1 / 4096)
                at = chroma_index[k, row, column]
                u = sampled(sources[3 * k + 1], strides[3 * k + 1], at, packed_fraction) - gray
                v = sampled(sources[3 * k + 2], strides[3 * k + 2], at, packed_fraction) - gray
                tint = colors[k, 0, 1] * u + colors[k, 0, 2] * v
                mean = np.float32(0)
                weights = np.float32(0)
                for p in range(4):
                    r, c = 2 * row + p // 2, 2 * column + p % 2
                    w = np.float32(1) if only != MIXED else np.float32(weight[k, r, c]) * np.float32(1 / 64)
                    y = sampled(sources[3 * k], strides[3 * k], index[k, r, c], fraction[k, r, c]) - black
                    total[p] += w * g * (colors[k, 0, 0] * y + tint)
                    mean += y
                    weights += w
                mean *= np.float32(0.25)
                weights *= np.float32(0.25)
                u_sum += weights * g * (colors[k, 1, 0] * mean + colors[k, 1, 1] * u + colors[k, 1, 2] * v)
                v_sum += weights * g * (colors[k, 2, 0] * mean + colors[k, 2, 1] * u + colors[k, 2, 2] * v)
            j, i = row * low.shape[0] // kind.shape[0], column * low.shape[1] // count
            change = np.float32(0)
            if low[j, i, 0] != 0 or low[j, i, 1] != 0 or low[j, i, 2] != 0:
                change = correction_at(low, row, column, 0, kind.shape[0], count)
                u_sum += correction_at(low, row, column, 1, kind.shape[0], count)
                v_sum += correction_at(low, row, column, 2, kind.shape[0], count)
            half = np.float32(0.5)
            for p in range(4):
                value = min(max(total[p] + change + black + half, np.float32(0)), largest)
                planes[0][2 * row + p // 2, 2 * column + p % 2] = value
            planes[1][row, column] = min(max(u_sum + gray + half, np.float32(0)), largest)
            planes[2][row, column] = min(max(v_sum + gray + half, np.float32(0)), largest)
