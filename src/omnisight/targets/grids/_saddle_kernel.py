"""The compiled part of `saddles`."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import outer


@outer
def sample_rings(image, pixels, circle):
    """Give the brightness (N, S) of a float image around N whole pixels at S places (S, 2), bilinearly."""
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


@outer
def saddle_strength(smooth):
    """Give minus the Hessian's determinant (H, W): positive at a saddle, the same however it is turned."""
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


@outer
def find_peaks(strength, floor, apart, rim):
    """Give the places (N, 2) and heights (N,) above `floor` that are highest within `apart` px; none near the edge."""
    rows, columns = strength.shape
    most = (rows // (apart + 1) + 1) * (columns // (apart + 1) + 1)
    places = np.empty((most, 2), np.float64)
    strengths = np.empty(most, np.float64)
    count = 0
    for v in range(rim, rows - rim):
        for u in range(rim, columns - rim):
            best = strength[v, u]
            if best <= floor:
                continue
            largest = True
            for y in range(max(v - apart, 0), min(v + apart, rows - 1) + 1):
                for x in range(max(u - apart, 0), min(u + apart, columns - 1) + 1):
                    if strength[y, x] > best:
                        largest = False
                        break
                if not largest:
                    break
            if largest and count < most:  # of equals there may be more
                places[count, 0], places[count, 1] = u, v
                strengths[count] = best
                count += 1
    return places[:count], strengths[:count]
