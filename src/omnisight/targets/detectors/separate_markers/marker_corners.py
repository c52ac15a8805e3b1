"""Subpixel corners of markers: the intersections of their fitted sides."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.detectors.separate_markers.side_fit import SideFits, Sides, fit_sides
from omnisight.targets.subpixel.point_fits import PointFits

Array = NDArray[np.float64]

# Error, px, of the model itself: cells blur into the border, and light varies nonlinearly.
MODEL_ERROR_PX = 0.02
# Fits of the sides, each of which starts at the previous ones: decoded corners are good to a pixel or two.
NUM_FITS = 3
# Iterations of the intersection of two almost straight lines.
NUM_ITERATIONS = 3
# Sine of the angle between two sides, below which they have no intersection.
MIN_DETERMINANT = 1e-3


def fit_marker_corners(gray: NDArray[Any], corners: Array, cells: NDArray[np.bool_], gap_cells: Array) -> PointFits:
    """Fit the sides of markers and intersect neighbouring ones.

    Parameters
    ----------
    gray : (H, W) array
    corners : (M, 4, 2) array
        Good to half a cell; NaN for markers that are not seen.
    cells : (M, N, N) array of bool
        White cells of the markers, their black border of one cell included.
    gap_cells : (M, 4) array
        Gap from each side, clockwise on the print, to the next marker, in cells; inf where there is none.

    Returns
    -------
    PointFits
        Of the corners (4 M): the amplitude is positive if the markers are darker than the paper.
    """
    # Behind each side, clockwise on the print: the cells next to the border.
    inner = np.stack([cells[:, 1], cells[:, :, -2], cells[:, -2, ::-1], cells[:, ::-1, 1]], axis=1)
    inner, gaps = inner.reshape(-1, cells.shape[1]), gap_cells.ravel()
    # Corner k is the first end of side k, and the last of the side before.
    before = np.arange(4 * len(corners)).reshape(-1, 4)[:, [3, 0, 1, 2]].ravel()
    bend = np.zeros(4 * len(corners))
    for _ in range(NUM_FITS - 1):
        sides = _sides(corners, bend, cells.shape[1])
        fits = fit_sides(gray, sides, inner, gaps)
        measured = _intersections(sides, fits, before)[0].reshape(-1, 4, 2)
        corners = np.where(np.isfinite(measured), measured, corners)
        bend += np.nan_to_num(fits.edge[:, 2])
    sides = _sides(corners, bend, cells.shape[1])
    fits = fit_sides(gray, sides, inner, gaps)
    pixels, covariance = _intersections(sides, fits, before)
    amplitude, blur = ((values + values[before]) / 2 for values in (fits.amplitude, fits.blur))
    explained = np.minimum(fits.explained, fits.explained[before])
    found = PointFits(pixels, covariance, amplitude, blur, explained)
    return found.with_noise_inflation(fits.inflation, MODEL_ERROR_PX)


def _sides(corners: Array, bend: Array, num_cells: int) -> Sides:
    """Return the sides of markers with these corners (M, 4, 2) and bends (4 M)."""
    end = np.roll(corners, -1, axis=1)
    length = np.linalg.norm(end - corners, axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (end - corners) / length[..., None]
    normal = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    # The neighbouring sides lead into the marker; in a mirror image that is to the other side.
    leading = np.stack([np.roll(corners, 1, axis=1) - corners, np.roll(end, -1, axis=1) - end], axis=2)
    depth = np.einsum("mkea,mka->mke", leading, normal) / num_cells
    sign = np.sign(depth.sum(axis=2, keepdims=True))
    middle, inward = (corners + end) / 2, normal * sign
    flat = (array.reshape(-1, 2) for array in (middle, along, inward))
    return Sides(*flat, length=length.ravel(), depth=(depth * sign).reshape(-1, 2), bend=bend)


def _intersections(sides: Sides, fits: SideFits, before: NDArray[np.intp]) -> tuple[Array, Array]:
    """Return the intersection (K, 2) of each side's beginning with the end of the side before, and its covariance."""
    # The two sides of each corner (K, 2), and where on them it is.
    pair = np.stack([before, np.arange(len(before))], axis=1)
    middle, along, inward, length, _, bend = (array[pair] for array in sides)
    edge, edge_covariance = fits.edge[pair], fits.covariance[pair]

    def tangents_meet(s: Array) -> tuple[Array, Array]:
        """Return where the tangents at `s` intersect, and how that moves with them."""
        shift = edge[..., 0] + edge[..., 1] * s + edge[..., 2] * s * s + bend * (s * s - 0.25)
        slope = (edge[..., 1] + 2 * (edge[..., 2] + bend) * s) / length
        on_side = middle + (s * length)[..., None] * along + shift[..., None] * inward
        normal = inward - slope[..., None] * along
        inverse = _inverse(normal)
        return np.einsum("kab,kb->ka", inverse, (normal * on_side).sum(axis=-1)), inverse

    s = np.broadcast_to(np.array([0.5, -0.5]), pair.shape)
    for _ in range(NUM_ITERATIONS):
        s = ((tangents_meet(s)[0][:, None] - middle) * along).sum(axis=-1) / length
    pixels, inverse = tangents_meet(s)
    powers = np.stack([np.ones_like(s), s, s * s], axis=-1)
    variance = np.einsum("kbi,kbij,kbj->kb", powers, edge_covariance, powers)
    return pixels, np.einsum("kab,kb,kcb->kac", inverse, variance, inverse)


def _inverse(matrices: Array) -> Array:
    """Return the inverse matrices (K, 2, 2); NaN where one is singular or unknown."""
    (a, b), (c, d) = np.moveaxis(matrices, 0, 2)
    determinant = a * d - b * c
    adjugate = np.moveaxis(np.array([[d, -b], [-c, a]]), 2, 0)
    return adjugate / np.where(np.abs(determinant) > MIN_DETERMINANT, determinant, np.nan)[:, None, None]
