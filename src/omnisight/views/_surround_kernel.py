"""Compiled part of `surround_remapper`: interpolate and blend the samples of each pixel of a view."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver


@njit_driver
def blend(buffer, table, gains, limit, rounding, first, low, high, view):
    """Write rows low to high of a view.

    Parameters
    ----------
    buffer : (N, 3) array
        The pixels of all images and their reduced copies.
    table : tuple of arrays
        For each sample: index of its upper left pixel, pixels per row of its image, horizontal and vertical fraction
        (1/256), weight and camera.
    gains : (cameras, 3) array of float32
    limit, rounding : float32
        Largest value, and what is added before truncation.
    first : (H W + 1,) array
        First sample of each pixel.
    view : (H, W, 3) array
    """
    index, stride, right, below, weight, camera = table
    width = view.shape[1]
    one = np.float32(1.0)
    step = np.float32(1 / 256)
    for row in range(low, high):
        for column in range(width):
            p = row * width + column
            red = green = blue = np.float32(0.0)
            for k in range(first[p], first[p + 1]):
                i = index[k]
                j = i + stride[k]
                fx, fy = right[k] * step, below[k] * step
                d = fx * fy
                a, b, c = one - fx - fy + d, fx - d, fy - d
                w, cam = weight[k], camera[k]
                red += (a * buffer[i, 0] + b * buffer[i + 1, 0] + c * buffer[j, 0] + d * buffer[j + 1, 0]) * (
                    w * gains[cam, 0]
                )
                green += (a * buffer[i, 1] + b * buffer[i + 1, 1] + c * buffer[j, 1] + d * buffer[j + 1, 1]) * (
                    w * gains[cam, 1]
                )
                blue += (a * buffer[i, 2] + b * buffer[i + 1, 2] + c * buffer[j, 2] + d * buffer[j + 1, 2]) * (
                    w * gains[cam, 2]
                )
            view[row, column, 0] = min(red + rounding, limit)
            view[row, column, 1] = min(green + rounding, limit)
            view[row, column, 2] = min(blue + rounding, limit)
