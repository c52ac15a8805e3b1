"""Compiled sampling of patches of the tangent plane, and their templates for the alignment with other images.

A patch is a grid of samples with coordinates x in a plane that touches the sphere. A quadratic map takes them to
pixels, p + A x + B (x1^2, x1 x2, x2^2), because a fisheye shows straight lines curved: with affine maps, patches near
the rims of two fisheyes back to back were 0.06 px off.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

from functools import partial

import numpy as np

from omnisight.compiled import njit_driver, njit_helper

# Samples of a patch: SIDE x SIDE, HALF on each side of its centre.
HALF = 4
SIDE = 2 * HALF + 1
SAMPLES = SIDE * SIDE

# Sums in any order, so that they are vectorized.
sums_helper = partial(njit_helper, fastmath={"contract", "reassoc"})


@sums_helper
def sample_patch(image, u, v, a, b, half, places, samples):
    """Fill the samples of a patch of 2 half + 1 rows by bilinear interpolation; return whether all are in the image.

    `places` (2, K) is memory for their positions.
    """
    side, low_end, right_end = 2 * half + 1, image.shape[0] - 1.0, image.shape[1] - 1.0
    is_inside = True
    for j in range(-half, half + 1):
        x0, y0 = u + (a[0, 1] + b[0, 2] * j) * j, v + (a[1, 1] + b[1, 2] * j) * j
        x1, y1 = a[0, 0] + b[0, 1] * j, a[1, 0] + b[1, 1] * j
        row = (j + half) * side
        for k in range(side):
            i = k - half
            x, y = x0 + (x1 + b[0, 0] * i) * i, y0 + (y1 + b[1, 0] * i) * i
            places[0, row + k], places[1, row + k] = x, y
            is_inside &= (x >= 0.0) & (x < right_end) & (y >= 0.0) & (y < low_end)
    if not is_inside:
        return False
    for k in range(side * side):
        x, y = places[0, k], places[1, k]
        column, row = int(x), int(y)  # positive, so this is the floor
        s, t = np.float32(x - column), np.float32(y - row)
        top, low = np.float32(image[row, column]), np.float32(image[row + 1, column])
        top += (np.float32(image[row, column + 1]) - top) * s
        low += (np.float32(image[row + 1, column + 1]) - low) * s
        samples[k] = top + (low - top) * t
    return True


@njit_helper
def on_level(maps, level, image_level):
    """Return the matrices A and B of a map from the template of a level to the image of another one."""
    unit, pixel = float(1 << level), float(1 << image_level)
    return maps[:, :2] * (unit / pixel), maps[:, 2:] * (unit * unit / pixel)


@njit_driver
def extract(levels, pixels, maps, rows, arrays, first, last):
    """Fill the templates of the patches first ... last on all levels.

    Parameters
    ----------
    levels
        Image pyramid; a level has half the size of the one before, and the same pixel (0, 0).
    pixels
        (N, 2) centres of the patches.
    maps
        (N, 2, 5) matrices A and B, px per unit of the patches and its square.
    rows
        (N,) rows of the arrays of each patch.
    arrays
        `templates` (R, L, S) receive the samples less their mean. `gradients` (R, L, S, 2) receive their derivatives
        along the patch, without what changes of contrast and brightness explain, and `inverses` (R, L, 2, 2) the
        inverses of their Gram matrices. `affine` (R, S, 6) receives the derivatives at the finest level by a shift (2)
        and a linear map (2, 2) of the patch, without what changes of contrast and brightness explain. `usable` (R, L)
        receives whether the patch is inside the image and has texture along both directions.
    """
    templates, gradients, inverses, affine, usable = arrays
    wide = SIDE + 2
    places, samples = np.empty((2, wide * wide)), np.empty(wide * wide, np.float32)
    for n in range(first, last):
        own = rows[n]
        for level in range(len(levels)):
            scale = 1.0 / (1 << level)
            usable[own, level] = False
            # Patches of level l cover 2^l times the angle with samples that are as far apart.
            a, b = on_level(maps[n], level, level)
            if not sample_patch(
                levels[level], pixels[n, 0] * scale, pixels[n, 1] * scale, a, b, HALF + 1, places, samples
            ):
                continue
            template, gradient = templates[own, level], gradients[own, level]
            mean = np.float32(0.0)
            for j in range(SIDE):
                for i in range(SIDE):
                    at, k = (j + 1) * wide + i + 1, j * SIDE + i
                    template[k] = samples[at]
                    gradient[k, 0] = np.float32(0.5) * (samples[at + 1] - samples[at - 1])
                    gradient[k, 1] = np.float32(0.5) * (samples[at + wide] - samples[at - wide])
                    mean += samples[at]
            mean /= np.float32(SAMPLES)
            if level == 0:
                _fill_affine(template, gradient, mean, affine[own])
            usable[own, level] = _project_out(template, gradient, mean, inverses[own, level])


@sums_helper
def _fill_affine(template, gradient, mean, affine):
    """Fill the derivatives by a shift and a linear map, without their mean and their part along the template."""
    energy = 0.0
    for k in range(SAMPLES):
        energy += (template[k] - mean) ** 2
        x, y = np.float32(k % SIDE - HALF), np.float32(k // SIDE - HALF)
        for axis in range(2):
            g = gradient[k, axis]
            affine[k, axis], affine[k, 2 + 2 * axis], affine[k, 3 + 2 * axis] = g, g * x, g * y
    for column in range(6):
        average, along = 0.0, 0.0
        for k in range(SAMPLES):
            average += affine[k, column]
            along += affine[k, column] * (template[k] - mean)
        average, along = average / SAMPLES, along / max(energy, 1e-9)
        for k in range(SAMPLES):
            affine[k, column] -= np.float32(average + along * (template[k] - mean))


@sums_helper
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
