"""Compiled alignment of patches of the tangent plane with an image (Kanade-Lucas-Tomasi).

A patch is a grid of samples with coordinates x in a plane that touches the sphere. An affine map takes them to pixels,
p + A x. Patches are aligned by the inverse compositional algorithm (S. Baker and I. Matthews, Lucas-Kanade 20 years on,
IJCV 2004), coarse to fine. Contrast and brightness are eliminated, so that changes of the exposure have no effect.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver, njit_helper

# Samples of a patch: SIDE x SIDE, HALF on each side of its centre.
HALF = 4
SIDE = 2 * HALF + 1
SAMPLES = SIDE * SIDE
# Steps per level, and the step (px) at which they end: far below the noise of the position.
MAX_STEPS, SMALL_STEP_PX = 10, 0.01
# Distance (px of the level) from its start at which a patch is another one: beyond half its size.
MAX_SHIFT = SIDE


@njit_helper
def _sample(image, x, y):
    """Return the bilinear interpolation at a position, -1 outside the image."""
    column, row = int(np.floor(x)), int(np.floor(y))
    if column < 0 or row < 0 or column >= image.shape[1] - 1 or row >= image.shape[0] - 1:
        return np.float32(-1.0)
    s, t = np.float32(x - column), np.float32(y - row)
    top = np.float32(image[row, column]) * (np.float32(1.0) - s) + np.float32(image[row, column + 1]) * s
    low = np.float32(image[row + 1, column]) * (np.float32(1.0) - s) + np.float32(image[row + 1, column + 1]) * s
    return top * (np.float32(1.0) - t) + low * t


@njit_helper
def _sample_patch(image, u, v, a, half, samples):
    """Fill the samples of a patch of 2 half + 1 rows; return whether all are inside the image."""
    k = 0
    for j in range(-half, half + 1):
        for i in range(-half, half + 1):
            value = _sample(image, u + a[0, 0] * i + a[0, 1] * j, v + a[1, 0] * i + a[1, 1] * j)
            if value < 0.0:
                return False
            samples[k] = value
            k += 1
    return True


@njit_driver
def extract(levels, pixels, maps, templates, gradients, inverses, usable, first, last):
    """Fill the templates of the patches first ... last on all levels.

    Parameters
    ----------
    levels
        Image pyramid; a level has half the size of the one before, and the same pixel (0, 0).
    pixels
        (N, 2) centres of the patches.
    maps
        (N, 2, 2) matrices A, px per unit of the patches.
    templates
        (N, L, S), receives the samples less their mean.
    gradients
        (N, L, S, 2), receives their derivatives along the patch, without what changes of contrast and brightness
        explain.
    inverses
        (N, L, 2, 2), receives the inverses of their Gram matrices.
    usable
        (N, L), receives whether the patch is inside the image and has texture along both directions.
    """
    wide = SIDE + 2
    samples = np.empty(wide * wide, np.float32)
    for n in range(first, last):
        for level in range(len(levels)):
            scale = 1.0 / (1 << level)
            usable[n, level] = False
            # Patches of level l cover 2^l times the angle with samples that are as far apart.
            if not _sample_patch(levels[level], pixels[n, 0] * scale, pixels[n, 1] * scale, maps[n], HALF + 1, samples):
                continue
            template, gradient = templates[n, level], gradients[n, level]
            mean = np.float32(0.0)
            for j in range(SIDE):
                for i in range(SIDE):
                    at, k = (j + 1) * wide + i + 1, j * SIDE + i
                    template[k] = samples[at]
                    gradient[k, 0] = np.float32(0.5) * (samples[at + 1] - samples[at - 1])
                    gradient[k, 1] = np.float32(0.5) * (samples[at + wide] - samples[at - wide])
                    mean += samples[at]
            mean /= np.float32(SAMPLES)
            usable[n, level] = _project_out(template, gradient, mean, inverses[n, level])


@njit_helper
def _project_out(template, gradient, mean, inverse):
    """Remove contrast and brightness from the gradients, and fill the inverse Gram matrix; False if it is singular."""
    energy, gx, gy, tx, ty = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(SAMPLES):
        template[k] -= mean
        energy += template[k] * template[k]
        gx += gradient[k, 0]
        gy += gradient[k, 1]
        tx += template[k] * gradient[k, 0]
        ty += template[k] * gradient[k, 1]
    if not energy > 0.0:
        return False
    gx, gy, tx, ty = gx / SAMPLES, gy / SAMPLES, tx / energy, ty / energy
    a, b, c = 0.0, 0.0, 0.0
    for k in range(SAMPLES):
        gradient[k, 0] -= np.float32(gx + tx * template[k])
        gradient[k, 1] -= np.float32(gy + ty * template[k])
        a += gradient[k, 0] * gradient[k, 0]
        b += gradient[k, 0] * gradient[k, 1]
        c += gradient[k, 1] * gradient[k, 1]
    determinant = a * c - b * b
    if not determinant > 1e-6 * (a + c) ** 2:
        return False
    inverse[0, 0], inverse[1, 1] = c / determinant, a / determinant
    inverse[0, 1] = inverse[1, 0] = -b / determinant
    return True


@njit_driver
def align(levels, templates, gradients, inverses, usable, maps, start, pixels, correlation, noise, first, last):
    """Align the patches first ... last, starting at pixels (N, 2), which receive the result.

    Parameters
    ----------
    levels, templates, gradients, inverses, usable, maps
        As in `extract`; the maps are those of the predicted patches.
    start
        (N,) coarsest level to use for each patch; -1 for none.
    correlation
        (N,), receives the normalized correlation at the finest level; -1 where the patch was not aligned.
    noise
        (N,), receives the root mean square difference of the intensities.
    """
    samples = np.empty(SAMPLES, np.float32)
    for n in range(first, last):
        u, v = pixels[n, 0], pixels[n, 1]
        correlation[n], noise[n] = -1.0, 0.0
        a = maps[n]
        for level in range(start[n], -1, -1):
            if not usable[n, level]:
                continue
            scale = 1.0 / (1 << level)
            found, x, y, similar, rms = _align_on_level(
                levels[level],
                templates[n, level],
                gradients[n, level],
                inverses[n, level],
                a,
                u * scale,
                v * scale,
                samples,
            )
            if not found and level == 0:
                break
            if found:
                u, v = x / scale, y / scale
                if level == 0:
                    correlation[n], noise[n] = similar, rms
        pixels[n, 0], pixels[n, 1] = u, v


@njit_helper
def _align_on_level(image, template, gradient, inverse, a, u, v, samples):
    """Return whether the alignment converged, the position, the correlation and the rms difference."""
    energy = 0.0
    for k in range(SAMPLES):
        energy += template[k] * template[k]
    x, y, similar, rms = u, v, -1.0, 0.0
    for _ in range(MAX_STEPS):
        if not _sample_patch(image, x, y, a, HALF, samples):
            return False, u, v, -1.0, 0.0
        mean, product, square = 0.0, 0.0, 0.0
        for k in range(SAMPLES):
            mean += samples[k]
        mean /= SAMPLES
        for k in range(SAMPLES):
            value = samples[k] - mean
            product += value * template[k]
            square += value * value
        similar = product / np.sqrt(max(energy * square, 1e-12))
        if not product > 0.0:
            return False, u, v, -1.0, 0.0
        # Not the contrast of least squares, which tends to zero far from the solution.
        contrast = np.sqrt(square / energy)
        dx, dy, total = 0.0, 0.0, 0.0
        for k in range(SAMPLES):
            difference = (samples[k] - mean) / contrast - template[k]
            dx += gradient[k, 0] * difference
            dy += gradient[k, 1] * difference
            total += difference * difference
        rms = np.sqrt(total / (SAMPLES - 4))
        sx = inverse[0, 0] * dx + inverse[0, 1] * dy
        sy = inverse[1, 0] * dx + inverse[1, 1] * dy
        px, py = a[0, 0] * sx + a[0, 1] * sy, a[1, 0] * sx + a[1, 1] * sy
        x, y = x - px, y - py
        if (x - u) ** 2 + (y - v) ** 2 > MAX_SHIFT**2:
            return False, u, v, -1.0, 0.0
        if px * px + py * py < SMALL_STEP_PX**2:
            break
    return True, x, y, similar, rms
