"""Dense stereo in rectified images: disparities, and the distances of their points."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.display import Displayed
from omnisight.optim.loss import NORMAL_MEDIAN
from omnisight.twoview.rectification import Rectification
from omnisight.twoview.triangulation import MIN_PARALLAX_SIGMA

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Side of the blocks that are compared, and bound of the gradients: on rendered pairs with blocks of 5 px or the bound
# 15, errors are 3 and 12 % larger.
BLOCK_PX, MAX_GRADIENT = 7, 63
# Penalties of disparities that differ by one and by more between neighbours: those that OpenCV recommends.
SMALL_CHANGE, LARGE_CHANGE = 8 * BLOCK_PX**2, 32 * BLOCK_PX**2
# Least margin of the best match over the others, percent, and largest difference of both directions.
UNIQUENESS_PERCENT, MAX_LEFT_RIGHT_PX = 10, 1
# Regions of at most so many pixels whose disparities differ by more from their surroundings are mismatches.
SPECKLE_PIXELS, SPECKLE_STEP_PX = 100, 2
# Distance from the edge of the scene within which its contrast disturbs the matching: half a block, the kernels of the
# gradient and of the interpolation, and the fading edge of an image circle.
EDGE_PX = 6
# Standard deviation of a disparity by the gradients of the block, px, above which it has no texture: without this limit
# two to three times as many pixels of a rendered sky have a distance, and 0 to 12 % more of the others.
MAX_BLOCK_SIGMA_PX = 0.25
# Standard deviation of the noise of an image of integers.
ROUNDING_SIGMA = 12**-0.5
# Disparities below zero that are searched: the noise of points at infinity does not become a distance.
BELOW_INFINITY_PX = 4
# Images are matched in bands of rows. They extend by so many rows into their neighbours, and over the seam of images of
# all angles about the baseline. A band has at most so many pairs of a pixel and a disparity, of four bytes each.
OVERLAP_ROWS, MAX_BAND_CELLS = 64, 250_000_000
# OpenCV stores disparities in sixteenths of a pixel, and searches a multiple of 16.
STEPS_PER_PX = 16


@dataclass(frozen=True, eq=False)
class DenseStereo(Displayed):
    """Distances in the pixels of camera a.

    Attributes
    ----------
    distance : (H, W) float32 array
        Distance along the bearing, from the centre of camera a, in the unit of the baseline; NaN where unknown.
    sigma : (H, W) float32 array
        Its standard deviation.
    disparity : (H', W') float32 array
        Disparities in the first rectified image, px; NaN where unknown.
    """

    distance: NDArray[np.float32] = field(repr=False)
    sigma: NDArray[np.float32] = field(repr=False)
    disparity: NDArray[np.float32] = field(repr=False)


def match_rows(
    rectification: Rectification, images: tuple[NDArray[np.uint8], NDArray[np.uint8]], seen: tuple[Mask, Mask]
) -> NDArray[np.float32]:
    """Match the rows of rectified images by semi-global matching (H. Hirschmueller, PAMI 30(2), 2008), as in OpenCV.

    Parameters
    ----------
    rectification
        The rectification.
    images
        (H, W) both rectified images, gray.
    seen
        (H, W) which of their pixels show the scene. Other pixels have no disparities, and are not matched.

    Returns
    -------
    (H, W) disparities in the first image, px; NaN where unknown. They passed the left-right consistency check.
    """
    import cv2

    shape = images[0].shape
    matcher, margin = _matcher(rectification.max_disparity)
    overlap = min(OVERLAP_ROWS, shape[0])
    mode = "wrap" if rectification.is_periodic else "edge"
    a, b = (np.pad(image, ((overlap, overlap), (0, 0)), mode) for image in images)
    a, b = (np.pad(image, ((0, 0), margin)) for image in (a, b))
    band = max(MAX_BAND_CELLS // (a.shape[1] * matcher.getNumDisparities()) - 2 * overlap, overlap)
    steps = np.empty(shape, np.int16)
    for top in range(0, shape[0], band):
        rows = slice(top, min(top + band, shape[0]) + 2 * overlap)
        found = matcher.compute(a[rows], b[rows])
        steps[top : top + band] = found[overlap : len(found) - overlap, margin[0] : margin[0] + shape[1]]
    unknown = (-BELOW_INFINITY_PX - 1) * STEPS_PER_PX
    steps[~(_both_seen(steps / STEPS_PER_PX, seen) & _has_texture(images[0], seen[0]))] = unknown
    cv2.filterSpeckles(steps, unknown, SPECKLE_PIXELS, SPECKLE_STEP_PX * STEPS_PER_PX)
    return np.where(steps > unknown, steps.astype(np.float32) / STEPS_PER_PX, np.float32(np.nan))


def _matcher(max_disparity: int) -> tuple[Any, tuple[int, int]]:
    """Return the matcher, and the columns to add on both sides: OpenCV needs all candidates of a pixel in the image."""
    import cv2

    count = -(-(max_disparity + BELOW_INFINITY_PX) // STEPS_PER_PX) * STEPS_PER_PX
    matcher = cv2.StereoSGBM.create(
        minDisparity=-BELOW_INFINITY_PX,
        numDisparities=count,
        blockSize=BLOCK_PX,
        P1=SMALL_CHANGE,
        P2=LARGE_CHANGE,
        disp12MaxDiff=MAX_LEFT_RIGHT_PX,
        preFilterCap=MAX_GRADIENT,
        uniquenessRatio=UNIQUENESS_PERCENT,
        mode=cv2.STEREO_SGBM_MODE_HH,  # eight paths: errors are a quarter smaller than with five
    )
    return matcher, (count - BELOW_INFINITY_PX, BELOW_INFINITY_PX)


def _both_seen(disparity: Array, seen: tuple[Mask, Mask]) -> Mask:
    """Return where a pixel and its match show the scene, and so do their surroundings."""
    import cv2

    kernel = np.ones((2 * EDGE_PX + 1, 2 * EDGE_PX + 1), np.uint8)
    a, b = (cv2.erode(np.asarray(mask, np.uint8), kernel, borderValue=1) > 0 for mask in seen)
    column = np.arange(a.shape[1]) - np.rint(disparity).astype(int)
    inside = (column >= 0) & (column < a.shape[1])
    return a & inside & np.take_along_axis(b, np.clip(column, 0, a.shape[1] - 1), axis=1)


def _has_texture(image: NDArray[np.uint8], seen: Mask) -> Mask:
    """Return where the gradients along the row, relative to the noise, determine the disparity of a block.

    The noise is the median response to the mask of J. Immerkaer, Fast noise variance estimation, CVIU 64(2), 1996.
    """
    import cv2

    second = np.array([1, -2, 1], np.float32)
    response = np.abs(cv2.sepFilter2D(image, cv2.CV_32F, second, second))[seen]
    noise = max(float(np.median(response)) / NORMAL_MEDIAN / 6, ROUNDING_SIGMA) if response.size else ROUNDING_SIGMA
    gradient = cv2.Sobel(image, cv2.CV_32F, 1, 0, ksize=3) / 8
    information = cv2.boxFilter(gradient**2, -1, (BLOCK_PX, BLOCK_PX), normalize=False)
    return np.asarray(2 * noise**2 < MAX_BLOCK_SIGMA_PX**2 * information)  # both images have noise


def distances(
    rectification: Rectification, disparity: NDArray[Any], sigma_px: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the distances from camera a of disparities, and their standard deviations.

    In the triangle of a point and both cameras, with the angles alpha and beta of the point from the baseline at
    cameras a and b, the distance is r = B sin(beta)/sin(beta - alpha), and dr/d(beta) = -B sin(alpha)/sin²(beta -
    alpha). Toward the epipoles the parallax of a point vanishes, and the standard deviation becomes infinite.

    Parameters
    ----------
    rectification
        The rectification.
    disparity
        (H, W) disparities in the first rectified image, px.
    sigma_px
        Standard deviation of disparities.

    Returns
    -------
    distance, sigma
        (H, W) each, in the unit of the baseline; NaN where the disparity is unknown or not positive.
    """
    alpha = rectification.angles(np.arange(disparity.shape[1]))
    parallax = disparity / rectification.px_per_rad
    beta = alpha + parallax
    known = (parallax > 0) & (beta < np.pi)
    sine = np.where(known, np.sin(parallax), np.nan)
    distance = rectification.baseline * np.sin(beta) / sine
    sigma = rectification.baseline * np.sin(alpha) / sine**2 * sigma_px / rectification.px_per_rad
    return distance.astype(np.float32), sigma.astype(np.float32)


def dense_stereo(
    rectification: Rectification,
    images: tuple[NDArray[np.uint8], NDArray[np.uint8]],
    seen: tuple[Mask, Mask],
    sigma_px: float,
    max_relative_sigma: float = 1 / MIN_PARALLAX_SIGMA,
) -> DenseStereo:
    """Return the distances of the pixels of camera a from rectified gray images.

    Parameters
    ----------
    rectification, images, seen
        See `match_rows`.
    sigma_px
        Standard deviation of disparities, px.
    max_relative_sigma
        Distances with a larger standard deviation, relative to the distance, are unknown.
    """
    disparity = match_rows(rectification, images, seen)
    distance, sigma = distances(rectification, disparity, sigma_px)
    distance[~(sigma <= max_relative_sigma * distance)] = np.nan
    nearest, sigma = (rectification.remap_back(values, "nearest") for values in (distance, sigma))
    smooth = rectification.remap_back(distance, "bilinear")
    # Between pixels of one surface; at its edges distances are not averaged.
    same_surface = np.abs(smooth - nearest) <= sigma
    seen_by_a = rectification.masks[0]
    distance = np.where(seen_by_a, np.where(same_surface, smooth, nearest), np.float32(np.nan))
    return DenseStereo(distance, np.where(np.isnan(distance), np.float32(np.nan), sigma), disparity)
