"""Makes the 8-bit gray picture that detectors look at, out of any picture."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

_LUMA = np.array([0.299, 0.587, 0.114], np.float32)  # ITU-R BT.601, as every 8-bit decoder weighs
_SAMPLES = 1_000_000


def to_gray8(image: NDArray[Any]) -> NDArray[np.uint8]:
    """Convert a picture to 8-bit gray.

    Parameters
    ----------
    image : (H, W), (H, W, 3) or (H, W, 4) array
        Gray, RGB or RGBA. Eight bits stay as they are; deeper and float pictures are stretched so that the
        1st percentile becomes 0 and the 99th 255. Transparent pixels (alpha 0), NaN and inf become 0.

    Returns
    -------
    (H, W) array of uint8

    Raises
    ------
    ValueError
        If the shape or the type is another.
    """
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] not in (3, 4)):
        raise ValueError(f"expected an image (H, W), (H, W, 3) or (H, W, 4), got shape {image.shape}")
    if image.dtype.kind not in "uifb":
        raise ValueError(f"expected an image of numbers, got {image.dtype}")
    visible = image[:, :, 3] > 0 if image.ndim == 3 and image.shape[2] == 4 else None
    gray = image if image.ndim == 2 else _luma(image[:, :, :3])
    gray = gray if gray.dtype == np.uint8 else _stretch(gray, visible)
    return gray if visible is None else np.where(visible, gray, np.uint8(0))


def _luma(rgb: NDArray[Any]) -> NDArray[Any]:
    if rgb.dtype == np.uint8:
        import cv2

        return cv2.cvtColor(np.ascontiguousarray(rgb), cv2.COLOR_RGB2GRAY)
    return rgb.astype(np.float32) @ _LUMA


def _stretch(gray: NDArray[Any], visible: NDArray[np.bool_] | None) -> NDArray[np.uint8]:
    gray = gray.astype(np.result_type(gray.dtype, np.float32))
    usable = np.isfinite(gray) if visible is None else np.isfinite(gray) & visible
    values = gray[usable]
    if values.size == 0:
        return np.zeros(gray.shape, np.uint8)
    low, high = np.percentile(values[:: max(1, values.size // _SAMPLES)], (1, 99))
    scale = 255.0 / (high - low) if high > low else 0.0
    scaled = np.clip((np.where(usable, gray, low) - low) * scale, 0, 255)
    return np.where(usable, np.rint(scaled), 0).astype(np.uint8)
