"""Subpixel corners: fit the crossing of two edges to the image around each corner.

The model is that of a camera image: two edges, straight or slightly curved, whose signs are multiplied and blurred by
a Gaussian, under light that may vary linearly.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.boards._protocol import MAX_WINDOW_SHARE
from omnisight.targets.subpixel.point_fits import (
    BLUR_RANGE_PX,
    MAX_ITERATIONS,
    MIN_AMPLITUDE,
    ROUNDING_VARIANCE,
    PointFits,
    contiguous_gray,
)

Array = NDArray[np.float64]

# Half the window's side over the step to the next corner, whose edge must stay outside. Where that is less than
# `SMALL_WINDOW_PX`, the window extends to `MAX_WINDOW_SHARE`: a small window needs every pixel.
HALF_SIDE = 0.42
SMALL_WINDOW_PX = 6.0
# Half the window's side at most, px: farther pixels add no accuracy. Second, for a test of many candidates.
MAX_HALF_SIDE_PX = (10.0, 6.0)
# Step, px and rad, that ends the fit, an order of magnitude below its accuracy. Second, for a test.
TOLERANCE = (5e-3, 5e-2)
# Step to the next corner, px, below which no window fits between the corners.
MIN_STEP_PX = 3.0
# Sine of the angle between two edges below which their crossing is undetermined.
MIN_SINE = 0.2
# Error, px, of the model itself: light, lens and print.
MODEL_ERROR_PX = 0.005
# Pixels from the image's edge within which demosaicking and sharpening distort corners.
BORDER_PX = 1.5


def fit_corners(gray: NDArray[Any], pixels: Array, steps: Array, bends: Array, *, rough: bool = False) -> PointFits:
    """Fit the crossing of two blurred edges to the image around each corner.

    Parameters
    ----------
    gray : (H, W) array of uint8
    pixels : (N, 2) array
        Starts, good to a third of the window.
    steps : (N, 2, 2) array
        Steps in px to the next corner along the first edge and along the second; they are the initial directions.
    bends : (N, 2, 2) array
        Curvature of the two edges: an edge runs through c + s step + s^2 bend. Zero where it is unknown.
    rough : bool
        Only test for corners, and locate them to a tenth of a pixel: in smaller windows, several times faster.
    """
    from omnisight.targets.subpixel import _corner_kernel

    square = (steps**2).sum(-1)
    length = np.sqrt(square)
    with np.errstate(invalid="ignore", divide="ignore"):
        half = np.maximum(HALF_SIDE * length, np.minimum(SMALL_WINDOW_PX, MAX_WINDOW_SHARE * length))
        shares = np.minimum(half, MAX_HALF_SIDE_PX[rough]) / length
        normals = np.stack([-steps[..., 1], steps[..., 0]], -1) / length[..., None]
        curvatures = (bends * normals).sum(-1) / square
        usable = np.isfinite(pixels).all(-1) & np.isfinite(curvatures).all(-1) & (length.min(axis=1) > MIN_STEP_PX)
        area = np.abs(steps[:, 0, 0] * steps[:, 1, 1] - steps[:, 0, 1] * steps[:, 1, 0])
        usable &= area > MIN_SINE * length.prod(axis=1)
    fits = PointFits.empty(len(pixels))
    limits = (TOLERANCE[rough], rough, MAX_ITERATIONS, MIN_AMPLITUDE**2, *BLUR_RANGE_PX, ROUNDING_VARIANCE, BORDER_PX)
    # Another memory layout would be compiled for anew.
    arrays = (np.array(a, np.float64, order="C") for a in (pixels, steps, curvatures, shares))
    memory, power = (_corner_kernel.new_window(), _corner_kernel.new_workspace()), np.zeros(2)
    _corner_kernel.fit_corners(contiguous_gray(gray), *arrays, usable, limits, *memory, tuple(fits), power)
    # Blur, demosaicking and JPEG correlate the noise of neighbouring pixels, which then averages out less.
    return fits.with_noise_inflation(power[0] / max(power[1], 1e-9), MODEL_ERROR_PX)
