"""Compiled alignment of patches of the tangent plane with an image (Kanade-Lucas-Tomasi).

A patch is a grid of samples with coordinates x in a plane that touches the sphere. A quadratic map takes them to
pixels, p + A x + B (x1^2, x1 x2, x2^2), because a fisheye shows straight lines curved: with affine maps, patches near
the rims of two fisheyes back to back were 0.06 px off. Patches are aligned by the inverse compositional algorithm (S.
Baker and I. Matthews, Lucas-Kanade 20 years on, IJCV 2004), coarse to fine. Contrast and brightness are eliminated, so
that changes of the exposure have no effect.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

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
def _sample_patch(image, u, v, a, b, half, samples):
    """Fill the samples of a patch of 2 half + 1 rows; return whether all are inside the image."""
    k = 0
    for j in range(-half, half + 1):
        for i in range(-half, half + 1):
            x = u + a[0, 0] * i + a[0, 1] * j + b[0, 0] * i * i + b[0, 1] * i * j + b[0, 2] * j * j
            y = v + a[1, 0] * i + a[1, 1] * j + b[1, 0] * i * i + b[1, 1] * i * j + b[1, 2] * j * j
            value = _sample(image, x, y)
            if value < 0.0:
                return False
            samples[k] = value
            k += 1
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
def extract(levels, pixels, maps, templates, gradients, inverses, affine, usable, first, last):
    """Fill the templates of the patches first ... last on all levels.

    Parameters
    ----------
    levels
        Image pyramid; a level has half the size of the one before, and the same pixel (0, 0).
    pixels
        (N, 2) centres of the patches.
    maps
        (N, 2, 5) matrices A and B, px per unit of the patches and its square.
    templates
        (N, L, S), receives the samples less their mean.
    gradients
        (N, L, S, 2), receives their derivatives along the patch, without what changes of contrast and brightness
        explain.
    inverses
        (N, L, 2, 2), receives the inverses of their Gram matrices.
    affine
        (N, S, 6), receives the derivatives at the finest level by a shift (2) and a linear map (2, 2) of the patch,
        without what changes of contrast and brightness explain.
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
            a, b = _on_level(maps[n], level, level)
            if not _sample_patch(levels[level], pixels[n, 0] * scale, pixels[n, 1] * scale, a, b, HALF + 1, samples):
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
            if level == 0:
                _fill_affine(template, gradient, mean, affine[n])
            usable[n, level] = _project_out(template, gradient, mean, inverses[n, level])


@njit_helper
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
def align(
    levels, arrays, maps, depths, start, slope_sigma, slopes, pixels, correlation, noise, uncertainty, first, last
):
    """Align the patches first ... last, starting at pixels (N, 2), which receive the result.

    At the finest level the slopes of the surface are refined too. The inverse depth of a plane is linear in the
    coordinates x of the patch, so slopes change the map by a matrix of rank one: A = A_0 - e g^T, with the derivative e
    of the pixel by the logarithm of the depth.

    Parameters
    ----------
    levels, maps
        As in `extract`; the maps are those of the predicted patches.
    arrays
        The templates, gradients, inverses, affine and usable of `extract`.
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
    samples, columns = np.empty(SAMPLES, np.float32), np.empty((SAMPLES, 4), np.float32)
    information, gradient, slope = np.empty((4, 4)), np.empty(4), np.empty(2)
    for n in range(first, last):
        u, v = pixels[n, 0], pixels[n, 1]
        correlation[n], noise[n] = -1.0, 0.0
        closer = _levels_closer(maps[n])
        for level in range(start[n], -1, -1):
            if not usable[n, level]:
                continue
            image_level = min(level + closer, len(levels) - 1)
            image, scale = levels[image_level], 1.0 / (1 << image_level)
            a, b = _on_level(maps[n], level, image_level)
            template, inverse = templates[n, level], inverses[n, level]
            found, x, y, similar, rms = _align_on_level(
                image, template, gradients[n, level], inverse, a, b, u * scale, v * scale, samples
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
            _fill_information(affine[n], a, depth, prior, columns, information)
            covariance = np.linalg.inv(information)
            found, x, y, similar, rms = _refine(
                image, template, columns, covariance, prior, a, b, depth, x, y, slope, samples, gradient
            )
            if found and similar > correlation[n]:
                u, v, correlation[n], noise[n] = x / scale, y / scale, similar, rms
                slopes[n, 0], slopes[n, 1] = slope[0], slope[1]
                copy_elements(uncertainty[n], covariance[:2, :2])
        pixels[n, 0], pixels[n, 1] = u, v


@njit_helper
def _energy(template):
    """Return the sum of the squared intensities of a template, whose mean is 0."""
    energy = 0.0
    for k in range(SAMPLES):
        energy += template[k] * template[k]
    return energy


@njit_helper
def _compare(image, template, energy, a, b, u, v, samples):
    """Sample a patch; return whether it is similar to its template, its mean, its contrast, and the correlation."""
    if not _sample_patch(image, u, v, a, b, HALF, samples):
        return False, 0.0, 0.0, -1.0
    mean, product, square = 0.0, 0.0, 0.0
    for k in range(SAMPLES):
        mean += samples[k]
    mean /= SAMPLES
    for k in range(SAMPLES):
        value = samples[k] - mean
        product += value * template[k]
        square += value * value
    if not product > 0.0:
        return False, mean, 0.0, -1.0
    # Not the contrast of least squares, which tends to zero far from the solution.
    return True, mean, np.sqrt(square / energy), product / np.sqrt(max(energy * square, 1e-12))


@njit_helper
def _align_on_level(image, template, gradient, inverse, a, b, u, v, samples):
    """Return whether the alignment converged, the position, the correlation and the rms difference."""
    energy = _energy(template)
    x, y, similar, rms = u, v, -1.0, 0.0
    for _ in range(MAX_STEPS):
        found, mean, contrast, similar = _compare(image, template, energy, a, b, x, y, samples)
        if not found:
            return False, u, v, -1.0, 0.0
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


@njit_helper
def _fill_information(affine, a, depth, prior, columns, information):
    """Fill the derivatives by a shift and the slopes, and their information (4, 4) with the prior of the slopes."""
    determinant = a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]
    determinant = determinant if determinant != 0.0 else np.inf
    # A^-1 e: the displacement in the patch by the logarithm of the depth.
    x = (a[1, 1] * depth[0] - a[0, 1] * depth[1]) / determinant
    y = (a[0, 0] * depth[1] - a[1, 0] * depth[0]) / determinant
    for k in range(SAMPLES):
        columns[k, 0], columns[k, 1] = affine[k, 0], affine[k, 1]
        for axis in range(2):
            columns[k, 2 + axis] = x * affine[k, 2 + axis] + y * affine[k, 4 + axis]
    for i in range(4):
        for j in range(i + 1):
            total = 0.0
            for k in range(SAMPLES):
                total += columns[k, i] * columns[k, j]
            information[i, j] = information[j, i] = total
    for i in range(2):
        information[i, i] += 1e-6
        information[2 + i, 2 + i] += prior


@njit_helper
def _refine(image, template, columns, covariance, prior, a, b, depth, u, v, slope, samples, gradient):
    """Refine position and slopes (2,), in place; return as `_align_on_level`."""
    energy = _energy(template)
    x, y, similar, rms = u, v, -1.0, 0.0
    for _ in range(MAX_SLOPE_STEPS):
        found, mean, contrast, similar = _compare(image, template, energy, a, b, x, y, samples)
        if not found:
            return False, u, v, -1.0, 0.0
        total = 0.0
        for i in range(2):
            gradient[i], gradient[2 + i] = 0.0, -prior * slope[i]
        for k in range(SAMPLES):
            difference = (samples[k] - mean) / contrast - template[k]
            total += difference * difference
            for i in range(4):
                gradient[i] += columns[k, i] * difference
        rms = np.sqrt(total / (SAMPLES - 4))
        step = covariance @ gradient
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
