"""Brightness between pixels, at a few thousand places."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def bilinear(image: NDArray[Any], pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Interpolate an (H, W) image at pixels (..., 2); outside, the nearest edge is taken; NaN at NaN.

    Unlike OpenCV's remap it takes any image width and does not round positions to 1/32 px.
    """
    last = np.array(image.shape[::-1]) - 1
    at = np.clip(pixels, 0, last)
    known = np.isfinite(at).all(axis=-1)
    at = np.where(np.expand_dims(known, -1), at, 0.0)
    u, v = np.moveaxis(np.minimum(at.astype(np.intp), last - 1), -1, 0)
    a, b = at[..., 0] - u, at[..., 1] - v
    top = (1 - a) * image[v, u] + a * image[v, u + 1]
    bottom = (1 - a) * image[v + 1, u] + a * image[v + 1, u + 1]
    return np.where(known, (1 - b) * top + b * bottom, np.nan)
