"""Compiled part of `saddles`."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver


@njit_driver
def sample_rings(image, pixels, circle):
    """Interpolate a float image at S offsets (S, 2) around N integer pixels: (N, S)."""
    rings = np.empty((len(pixels), len(circle)), np.float32)
    for n in range(len(pixels)):
        for s in range(len(circle)):
            x, y = pixels[n, 0] + circle[s, 0], pixels[n, 1] + circle[s, 1]
            u, v = int(x), int(y)
            a, b = x - u, y - v
            top = (1 - a) * image[v, u] + a * image[v, u + 1]
            bottom = (1 - a) * image[v + 1, u] + a * image[v + 1, u + 1]
            rings[n, s] = (1 - b) * top + b * bottom
    return rings


@njit_driver
def saddle_strength(smooth):
    """Return minus the determinant of the Hessian (H, W): positive at a saddle, and invariant to rotation."""
    rows, columns = smooth.shape
    strength = np.zeros((rows, columns), np.float32)
    quarter = np.float32(0.25)
    for v in range(1, rows - 1):
        above, here, below, out = smooth[v - 1], smooth[v], smooth[v + 1], strength[v]
        for u in range(1, columns - 1):
            twice = here[u] + here[u]
            uu = here[u - 1] + here[u + 1] - twice
            vv = above[u] + below[u] - twice
            uv = (below[u + 1] - below[u - 1] - above[u + 1] + above[u - 1]) * quarter
            out[u] = uv * uv - uu * vv
    return strength


@njit_driver
def find_peaks(strength, floor, distance, border):
    """Return pixels (N, 2) and strengths (N,) above `floor` of the maxima within `distance` px, off the border."""
    rows, columns = strength.shape
    max_count = (rows // (distance + 1) + 1) * (columns // (distance + 1) + 1)
    pixels = np.empty((max_count, 2), np.float64)
    strengths = np.empty(max_count, np.float64)
    count = 0
    for v in range(border, rows - border):
        for u in range(border, columns - border):
            best = strength[v, u]
            if best <= floor:
                continue
            largest = True
            for y in range(max(v - distance, 0), min(v + distance, rows - 1) + 1):
                for x in range(max(u - distance, 0), min(u + distance, columns - 1) + 1):
                    if strength[y, x] > best:
                        largest = False
                        break
                if not largest:
                    break
            if largest and count < max_count:  # equal neighbours may exceed it
                pixels[count, 0], pixels[count, 1] = u, v
                strengths[count] = best
                count += 1
    return pixels[:count], strengths[:count]
