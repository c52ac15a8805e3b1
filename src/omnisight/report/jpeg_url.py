"""Images that are embedded in a page."""

import base64
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.images import UnreadableImage, read_image, to_gray8

JPEG_QUALITY = 72  # about a fifth of a byte per pixel


def jpeg_url(path: Path, width: int, apply_exif: bool) -> str | None:
    """Return an image file as a data: URL of a JPEG of at most a width (px); None if it cannot be read."""
    try:
        return encode_jpeg_url(read_image(path, apply_exif=apply_exif), width)
    except UnreadableImage:
        return None


def encode_jpeg_url(pixels: NDArray[Any], width: int) -> str:
    """Return an image (H, W) or (H, W, C) as a data: URL of a JPEG of at most a width (px)."""
    import cv2

    bgr: Any = pixels[..., 2::-1] if pixels.ndim == 3 and pixels.dtype == np.uint8 else to_gray8(pixels)
    height = max(1, round(pixels.shape[0] * width / pixels.shape[1]))
    if width < pixels.shape[1]:
        bgr = cv2.resize(np.ascontiguousarray(bgr), (width, height), interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", np.ascontiguousarray(bgr), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode()
