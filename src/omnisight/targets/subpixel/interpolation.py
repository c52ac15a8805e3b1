"""Bilinear interpolation at scattered pixels."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


def bilinear(image: NDArray[Any], pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Interpolate an (H, W) image at pixels (..., 2); clamp to the image's edge; NaN at NaN.

    Unlike OpenCV's `remap` it takes images of any width and does not round positions to 1/32 px.
    """
    last = np.array(image.shape[::-1]) - 1
    clamped = np.clip(pixels, 0, last)
    known = np.isfinite(clamped).all(axis=-1)
    clamped = np.where(np.expand_dims(known, -1), clamped, 0.0)
    u, v = np.moveaxis(np.minimum(clamped.astype(np.intp), last - 1), -1, 0)
    a, b = clamped[..., 0] - u, clamped[..., 1] - v
    top = (1 - a) * image[v, u] + a * image[v, u + 1]
    bottom = (1 - a) * image[v + 1, u] + a * image[v + 1, u + 1]
    return np.where(known, (1 - b) * top + b * bottom, np.nan)
