"""Order of the channels of images: ours is RGB, that of OpenCV's codecs BGR."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


def swap_red_and_blue(image: NDArray[Any]) -> NDArray[Any]:
    """Return an image (H, W, 3) or (H, W, 4) with the first and the third channel exchanged, contiguous."""
    import cv2

    swapped = np.empty(image.shape, image.dtype)
    pairs = (0, 2, 1, 1, 2, 0, 3, 3)[: 2 * image.shape[2]]
    # Indexing the last axis takes ten times as long: 14 ms for an image of 1500x1500 px, and this 1.4 ms.
    cv2.mixChannels([np.ascontiguousarray(image)], [swapped], pairs)
    return swapped
