"""Conversion of any image to 8-bit gray, the input of the detectors."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

# ITU-R BT.601, the weights of OpenCV and of JPEG.
LUMA_WEIGHTS = np.array([0.299, 0.587, 0.114], np.float32)
# Pixels from which the percentiles of a deep image are estimated.
MAX_PERCENTILE_SAMPLES = 1_000_000


def to_gray8(image: NDArray[Any]) -> NDArray[np.uint8]:
    """Convert an image to 8-bit gray.

    Parameters
    ----------
    image : (H, W), (H, W, 3) or (H, W, 4) array
        Gray, RGB or RGBA. Images of 8 bits keep their values. Deeper and float images are stretched: the 1st
        percentile becomes 0 and the 99th becomes 255. Transparent pixels (alpha 0), NaN and inf become 0.

    Returns
    -------
    (H, W) array of uint8, which is writable: compiled loops are not compiled for read-only arrays

    Raises
    ------
    ValueError
        If shape or type is not supported.
    """
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] not in (3, 4)):
        raise ValueError(f"expected an image (H, W), (H, W, 3) or (H, W, 4), got shape {image.shape}")
    if image.dtype.kind not in "uifb":
        raise ValueError(f"expected an image of numbers, got {image.dtype}")
    opaque = image[:, :, 3] > 0 if image.ndim == 3 and image.shape[2] == 4 else None
    gray = image if image.ndim == 2 else _luma(image[:, :, :3])
    gray = gray if gray.dtype == np.uint8 else _stretch(gray, opaque)
    return np.require(gray, requirements="W") if opaque is None else np.where(opaque, gray, np.uint8(0))


def _luma(rgb: NDArray[Any]) -> NDArray[Any]:
    if rgb.dtype == np.uint8:
        import cv2

        return cv2.cvtColor(np.ascontiguousarray(rgb), cv2.COLOR_RGB2GRAY)
    return rgb.astype(np.float32) @ LUMA_WEIGHTS


def _stretch(gray: NDArray[Any], opaque: NDArray[np.bool_] | None) -> NDArray[np.uint8]:
    gray = gray.astype(np.result_type(gray.dtype, np.float32))
    usable = np.isfinite(gray) if opaque is None else np.isfinite(gray) & opaque
    values = gray[usable]
    if values.size == 0:
        return np.zeros(gray.shape, np.uint8)
    low, high = np.percentile(values[:: max(1, values.size // MAX_PERCENTILE_SAMPLES)], (1, 99))
    scale = 255.0 / (high - low) if high > low else 0.0
    scaled = np.clip((np.where(usable, gray, low) - low) * scale, 0, 255)
    return np.where(usable, np.rint(scaled), 0).astype(np.uint8)
