"""Compiled whitened tangents of measured bearings, from the maps of their patches to pixels."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver


@njit_driver
def whitened_axes(maps, units, bearings, of_noise, variance, axes):
    """Fill the whitened tangents (N, 2, 3) L^-1 P of bearings b: P are pixels per radian, and L L^T is the covariance.

    P = A U^+, with the pseudo-inverse of the units U across the bearing, and L L^T = A N A^T + v I.

    Parameters
    ----------
    maps
        (N, 2, 5) derivatives of pixels by the units of a patch; the first two columns are A.
    units
        (N, 3, 2) what a unit of the patch is on the unit sphere.
    bearings
        (N, 3).
    of_noise
        (N, 2, 2) covariances N of the position by the noise of the image, square units of the patch.
    variance
        (N,) further variances v of pixels.
    axes
        Receives the result; NaN where A is not known.
    """
    across = np.empty((3, 2))
    for n in range(len(bearings)):
        for j in range(2):
            along = 0.0
            for k in range(3):
                along += bearings[n, k] * units[n, k, j]
            for k in range(3):
                across[k, j] = units[n, k, j] - along * bearings[n, k]
        # (U^T U)^-1.
        g, h, i = 0.0, 0.0, 0.0
        for k in range(3):
            g += across[k, 0] * across[k, 0]
            h += across[k, 0] * across[k, 1]
            i += across[k, 1] * across[k, 1]
        determinant = g * i - h * h
        a, noise = maps[n], of_noise[n]
        # A N A^T + v I, and its Cholesky factor.
        p = a[0, 0] * noise[0, 0] + a[0, 1] * noise[1, 0], a[0, 0] * noise[0, 1] + a[0, 1] * noise[1, 1]
        q = a[1, 0] * noise[0, 0] + a[1, 1] * noise[1, 0], a[1, 0] * noise[0, 1] + a[1, 1] * noise[1, 1]
        l00 = np.sqrt(p[0] * a[0, 0] + p[1] * a[0, 1] + variance[n])
        l10 = (q[0] * a[0, 0] + q[1] * a[0, 1]) / l00
        l11 = np.sqrt(q[0] * a[1, 0] + q[1] * a[1, 1] + variance[n] - l10 * l10)
        for k in range(3):
            first = (i * across[k, 0] - h * across[k, 1]) / determinant
            second = (g * across[k, 1] - h * across[k, 0]) / determinant
            axes[n, 0, k] = (a[0, 0] * first + a[0, 1] * second) / l00
            axes[n, 1, k] = (a[1, 0] * first + a[1, 1] * second - l10 * axes[n, 0, k]) / l11
