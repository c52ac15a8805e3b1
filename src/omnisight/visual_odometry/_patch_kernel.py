"""Compiled alignment of patches of the tangent plane with an image (Kanade-Lucas-Tomasi).

A patch is a grid of samples with coordinates x in a plane that touches the sphere. A quadratic map takes them to
pixels, p + A x + B (x1^2, x1 x2, x2^2), because a fisheye shows straight lines curved: with affine maps, patches near
the rims of two fisheyes back to back were 0.06 px off. Patches are aligned by the inverse compositional algorithm (S.
Baker and I. Matthews, Lucas-Kanade 20 years on, IJCV 2004), coarse to fine. Contrast and brightness are eliminated, so
that changes of the exposure have no effect.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

from functools import partial
from typing import Any

import numpy as np

from omnisight.compiled import njit_driver, njit_helper
from omnisight.twoview._small_vectors_kernel import copy_elements

# Samples of a patch: SIDE x SIDE, HALF on each side of its centre.
HALF = 4
SIDE = 2 * HALF + 1
SAMPLES = SIDE * SIDE
# Steps per level, and the step (px) at which they end: far below the noise of the position.
MAX_STEPS, SMALL_STEP_PX = 10, 0.01
# Steps of the refinement of the slopes.
MAX_SLOPE_STEPS = 6
# Largest correction (px) of the position by this refinement: a larger one belongs to another surface.
MAX_SLOPE_SHIFT = 1.5
# Distance (px of the level) from its start at which a patch is another one: beyond half its size.
MAX_SHIFT = SIDE

# Sums in any order, so that they are vectorized.
_FAST: Any = {"fastmath": {"contract", "reassoc"}}
_helper = partial(njit_helper, **_FAST)


@_helper
def _sample_patch(image, u, v, a, b, half, places, samples):
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
def _on_level(maps, level, image_level):
    """Return the matrices A and B of a map from the template of a level to the image of another one."""
    unit, pixel = float(1 << level), float(1 << image_level)
    return maps[:, :2] * (unit / pixel), maps[:, 2:] * (unit * unit / pixel)


@njit_helper
def _levels_closer(maps):
    """Return how many levels coarser than the template the image is whose pixels are as large as the samples."""
    area = abs(maps[0, 0] * maps[1, 1] - maps[0, 1] * maps[1, 0])
    return int(np.rint(0.5 * np.log2(max(area, 1.0))))


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
            a, b = _on_level(maps[n], level, level)
            if not _sample_patch(
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


@_helper
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


@_helper
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
def align(
    levels, arrays, rows, maps, depths, start, slope_sigma, slopes, pixels, correlation, noise, uncertainty, first, last
):
    """Align the patches first ... last, starting at pixels (N, 2), which receive the result.

    At the finest level the slopes of the surface are refined too. The inverse depth of a plane is linear in the
    coordinates x of the patch, so slopes change the map by a matrix of rank one: A = A_0 - e g^T, with the derivative e
    of the pixel by the logarithm of the depth.

    Parameters
    ----------
    levels, maps
        As in `extract`; the maps are those of the predicted patches.
    arrays, rows
        As in `extract`.
    depths
        (N, 2) derivatives of the pixels by the logarithm of the depth.
    start
        (N,) coarsest level to use for each patch; -1 for none.
    slope_sigma
        (N,) standard deviation of the slopes; 0 where they are not refined.
    slopes
        (N, 2) slopes g: change of the inverse depth per unit of the patch, over the inverse depth. Receives the result.
    correlation
        (N,), receives the normalized correlation at the finest level; -1 where the patch was not aligned.
    noise
        (N,), receives the root mean square difference of the intensities.
    uncertainty
        (N, 2, 2), receives the covariance of the shift of the patch over the variance of the intensities.
    """
    templates, gradients, inverses, affine, usable = arrays
    places, samples, columns = np.empty((2, SAMPLES)), np.empty(SAMPLES, np.float32), np.empty((4, SAMPLES), np.float32)
    information, gradient, step, slope = np.empty((4, 4)), np.empty(4), np.empty(4), np.empty(2)
    for n in range(first, last):
        own, u, v = rows[n], pixels[n, 0], pixels[n, 1]
        correlation[n], noise[n] = -1.0, 0.0
        closer = _levels_closer(maps[n])
        for level in range(start[n], -1, -1):
            if not usable[own, level]:
                continue
            image_level = min(level + closer, len(levels) - 1)
            image, scale = levels[image_level], 1.0 / (1 << image_level)
            a, b = _on_level(maps[n], level, image_level)
            template, inverse = templates[own, level], inverses[own, level]
            found, x, y, similar, rms = _align_on_level(
                image, template, gradients[own, level], inverse, a, b, u * scale, v * scale, places, samples
            )
            if found:
                u, v = x / scale, y / scale
            if level > 0 or not found:
                continue
            correlation[n], noise[n] = similar, rms
            copy_elements(uncertainty[n], inverse)
            if not slope_sigma[n] > 0.0:
                continue
            depth, prior = depths[n] * scale, (max(rms, 1.0) / slope_sigma[n]) ** 2
            slope[0], slope[1] = slopes[n, 0], slopes[n, 1]
            _fill_information(affine[own], a, depth, prior, columns, information)
            covariance = np.linalg.inv(information)
            found, x, y, similar, rms = _refine(
                image, template, columns, covariance, prior, a, b, depth, x, y, slope, places, samples, gradient, step
            )
            if found and similar > correlation[n]:
                u, v, correlation[n], noise[n] = x / scale, y / scale, similar, rms
                slopes[n, 0], slopes[n, 1] = slope[0], slope[1]
                copy_elements(uncertainty[n], covariance[:2, :2])
        pixels[n, 0], pixels[n, 1] = u, v


@_helper
def _energy(template):
    """Return the sum of the squared intensities of a template, whose mean is 0."""
    energy = 0.0
    for k in range(SAMPLES):
        energy += template[k] * template[k]
    return energy


@_helper
def _compare(image, template, energy, a, b, u, v, places, samples):
    """Sample a patch; return whether it is similar to its template, its contrast, the correlation and the difference.

    The difference is the root mean square of d = (s - mean) / contrast - t. The template t has the mean 0, and the
    contrast is that of both energies, so the sum of d^2 is 2 energy (1 - correlation). Derivatives g from which
    brightness and contrast are eliminated have no part along 1 and t, so the sum of g d is that of g s / contrast.
    """
    if not _sample_patch(image, u, v, a, b, HALF, places, samples):
        return False, 0.0, -1.0, 0.0
    total, product, square = 0.0, 0.0, 0.0
    origin = samples[SAMPLES // 2]  # sums are exactly zero where the image is constant
    for k in range(SAMPLES):
        value = float(samples[k] - origin)
        total += value
        product += value * template[k]
        square += value * value
    square -= total * total / SAMPLES
    if not (product > 0.0 and square > 0.0):
        return False, 0.0, -1.0, 0.0
    similar = product / np.sqrt(max(energy * square, 1e-12))
    # Not the contrast of least squares, which tends to zero far from the solution.
    return True, np.sqrt(square / energy), similar, np.sqrt(max(2 * energy * (1 - similar), 0.0) / (SAMPLES - 4))


@_helper
def _align_on_level(image, template, gradient, inverse, a, b, u, v, places, samples):
    """Return whether the alignment converged, the position, the correlation and the rms difference."""
    energy = _energy(template)
    x, y, similar, rms = u, v, -1.0, 0.0
    for _ in range(MAX_STEPS):
        found, contrast, similar, rms = _compare(image, template, energy, a, b, x, y, places, samples)
        if not found:
            return False, u, v, -1.0, 0.0
        dx, dy = 0.0, 0.0
        for k in range(SAMPLES):
            dx += gradient[k, 0] * samples[k]
            dy += gradient[k, 1] * samples[k]
        sx = (inverse[0, 0] * dx + inverse[0, 1] * dy) / contrast
        sy = (inverse[1, 0] * dx + inverse[1, 1] * dy) / contrast
        px, py = a[0, 0] * sx + a[0, 1] * sy, a[1, 0] * sx + a[1, 1] * sy
        x, y = x - px, y - py
        if (x - u) ** 2 + (y - v) ** 2 > MAX_SHIFT**2:
            return False, u, v, -1.0, 0.0
        if px * px + py * py < SMALL_STEP_PX**2:
            break
    return True, x, y, similar, rms


@_helper
def _fill_information(affine, a, depth, prior, columns, information):
    """Fill the derivatives by a shift and the slopes, and their information (4, 4) with the prior of the slopes."""
    determinant = a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]
    determinant = determinant if determinant != 0.0 else np.inf
    # A^-1 e: the displacement in the patch by the logarithm of the depth.
    x = (a[1, 1] * depth[0] - a[0, 1] * depth[1]) / determinant
    y = (a[0, 0] * depth[1] - a[1, 0] * depth[0]) / determinant
    for k in range(SAMPLES):
        columns[0, k], columns[1, k] = affine[k, 0], affine[k, 1]
        for axis in range(2):
            columns[2 + axis, k] = x * affine[k, 2 + axis] + y * affine[k, 4 + axis]
    for i in range(4):
        for j in range(i + 1):
            total = 0.0
            for k in range(SAMPLES):
                total += columns[i, k] * columns[j, k]
            information[i, j] = information[j, i] = total
    for i in range(2):
        information[i, i] += 1e-6
        information[2 + i, 2 + i] += prior


@_helper
def _refine(image, template, columns, covariance, prior, a, b, depth, u, v, slope, places, samples, gradient, step):
    """Refine position and slopes (2,), in place; return as `_align_on_level`."""
    energy = _energy(template)
    x, y, similar, rms = u, v, -1.0, 0.0
    for _ in range(MAX_SLOPE_STEPS):
        found, contrast, similar, rms = _compare(image, template, energy, a, b, x, y, places, samples)
        if not found:
            return False, u, v, -1.0, 0.0
        c0, c1, c2, c3 = 0.0, 0.0, 0.0, 0.0
        for k in range(SAMPLES):
            value = samples[k]
            c0 += columns[0, k] * value
            c1 += columns[1, k] * value
            c2 += columns[2, k] * value
            c3 += columns[3, k] * value
        gradient[0], gradient[1] = c0 / contrast, c1 / contrast
        gradient[2], gradient[3] = c2 / contrast - prior * slope[0], c3 / contrast - prior * slope[1]
        for i in range(4):  # numba's product of matrices calls BLAS, which takes as long as the rest of the step
            step[i] = 0.0
            for j in range(4):
                step[i] += covariance[i, j] * gradient[j]
        for i in range(2):
            for j in range(2):
                a[i, j] -= depth[i] * step[2 + j]
            slope[i] += step[2 + i]
        px, py = a[0, 0] * step[0] + a[0, 1] * step[1], a[1, 0] * step[0] + a[1, 1] * step[1]
        x, y = x - px, y - py
        if (x - u) ** 2 + (y - v) ** 2 > MAX_SLOPE_SHIFT**2:
            return False, u, v, -1.0, 0.0
        if px * px + py * py < SMALL_STEP_PX**2:
            break
    return True, x, y, similar, rms
