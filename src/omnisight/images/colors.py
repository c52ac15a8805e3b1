"""Colours of pixels."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


def colors_at(image: NDArray[Any], pixels: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return the colours (N, 3), RGB of 8 bits, of the pixels (N, 2) of an image of any type."""
    columns, rows = np.rint(pixels).astype(int).T
    rows, columns = np.clip(rows, 0, image.shape[0] - 1), np.clip(columns, 0, image.shape[1] - 1)
    gray_or_rgb = image if image.ndim == 3 else np.repeat(image[:, :, None], 3, axis=2)
    colors = gray_or_rgb[rows, columns, :3]
    if colors.dtype == np.uint8:
        return np.asarray(colors, np.uint8)
    white = np.iinfo(colors.dtype).max if np.issubdtype(colors.dtype, np.integer) else 1.0
    return np.clip(np.nan_to_num(colors.astype(float)) / white * 255, 0, 255).astype(np.uint8)
