"""Compiled alignment of patches of the tangent plane with an image (Kanade-Lucas-Tomasi).

Patches are aligned by the inverse compositional algorithm (S. Baker and I. Matthews, Lucas-Kanade 20 years on, IJCV
2004), coarse to fine. Contrast and brightness are eliminated, so that changes of the exposure have no effect.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver, njit_helper
from omnisight.twoview._small_vectors_kernel import copy_elements
from omnisight.visual_odometry._patch_kernel import HALF, SAMPLES, SIDE, on_level, sample_patch, sums_helper

# Steps per level, and the step (px) at which they end: far below the noise of the position.
MAX_STEPS, SMALL_STEP_PX = 10, 0.01
# Steps of the refinement of the slopes.
MAX_SLOPE_STEPS = 6
# Largest correction (px) of the position by this refinement: a larger one belongs to another surface.
MAX_SLOPE_SHIFT = 1.5
# Distance (px of the level) from its start at which a patch is another one: beyond half its size.
MAX_SHIFT = SIDE


@njit_helper
def _levels_closer(maps):
    """Return how many levels coarser than the template the image is whose pixels are as large as the samples."""
    area = abs(maps[0, 0] * maps[1, 1] - maps[0, 1] * maps[1, 0])
    return int(np.rint(0.5 * np.log2(max(area, 1.0))))


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
            a, b = on_level(maps[n], level, image_level)
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


@sums_helper
def _energy(template):
    """Return the sum of the squared intensities of a template, whose mean is 0."""
    energy = 0.0
    for k in range(SAMPLES):
        energy += template[k] * template[k]
    return energy


@sums_helper
def _compare(image, template, energy, a, b, u, v, places, samples):
    """Sample a patch; return whether it is similar to its template, its contrast, the correlation and the difference.

    The difference is the root mean square of d = (s - mean) / contrast - t. The template t has the mean 0, and the
    contrast is that of both energies, so the sum of d^2 is 2 energy (1 - correlation). Derivatives g from which
    brightness and contrast are eliminated have no part along 1 and t, so the sum of g d is that of g s / contrast.
    """
    if not sample_patch(image, u, v, a, b, HALF, places, samples):
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


@sums_helper
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


@sums_helper
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


@sums_helper
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
