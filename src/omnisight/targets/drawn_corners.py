"""Images onto which detected corners were drawn, as `cv2.drawChessboardCorners` does: the drawing hides the corners."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.detections import ImageDetection

# Half the side, px, of the neighbourhoods of corners in which drawings are looked for.
RADIUS = 7
# Difference of the largest and the smallest colour channel of a pixel of a drawing. Chromatic aberration reaches 40.
MIN_CHROMA = 80
# Share of the corners with such a pixel, and share of the pixels around corners that each of the hues has. OpenCV draws
# each row of corners in another colour of the rainbow.
MIN_CORNER_SHARE = 0.25
MIN_HUE_SHARE = 0.005
MIN_HUES = 4


def has_drawn_corners(image: NDArray[Any], pixels: NDArray[np.float64]) -> bool:
    """Return whether rows of different colours were drawn at the corners `pixels` (N, 2) of an image (H, W[, C])."""
    import cv2

    if image.ndim != 3 or image.shape[2] < 3 or image.dtype != np.uint8 or not len(pixels):
        return False
    bgr = np.ascontiguousarray(image[..., :3])
    height, width = bgr.shape[:2]
    x, y = np.clip(np.rint(pixels).astype(int), 0, [width - 1, height - 1]).T
    neighbourhood = np.ones((2 * RADIUS + 1, 2 * RADIUS + 1), np.uint8)
    blue, green, red = cv2.split(bgr)
    chroma = cv2.max(cv2.max(blue, green), red) - cv2.min(cv2.min(blue, green), red)
    vivid = (chroma > MIN_CHROMA).astype(np.uint8)
    if cv2.dilate(vivid, neighbourhood)[y, x].mean() < MIN_CORNER_SHARE:
        return False
    near = np.zeros((height, width), np.uint8)
    near[y, x] = 1
    near = cv2.dilate(near, neighbourhood) > 0
    hue = cv2.cvtColor(bgr, cv2.COLOR_BGR2HSV)[..., 0][near & (vivid > 0)]
    shares = np.bincount(hue // 30, minlength=6) / near.sum()  # sextants; OpenCV's hue has 180 values
    return int((shares > MIN_HUE_SHARE).sum()) >= MIN_HUES


def leave_out_drawn_corners(
    images: Sequence[ImageDetection], drawn: Sequence[bool]
) -> tuple[list[ImageDetection], list[str]]:
    """Leave out images with drawn corners if as many others show the board; return all images, and a note on the set.

    Parameters
    ----------
    images : sequence of ImageDetection
    drawn : sequence of bool
        Whether corners were drawn onto each image.
    """
    detected = [i for i, image in enumerate(images) if image.boards]
    affected = [i for i in detected if drawn[i]]
    if not affected:
        return list(images), []
    left_out = 2 * len(affected) <= len(detected)
    results = list(images)
    for i in affected:
        remark = "detected corners were drawn onto the image"
        results[i] = (
            ImageDetection(images[i].path, note=f"{remark}: left out")
            if left_out
            else images[i].with_remark(f"{remark}, which hides the true ones")
        )
    names = ", ".join(images[i].path.name for i in affected[:3]) + (", ..." if len(affected) > 3 else "")
    consequence = "are left out" if left_out else "are less accurate: use the original images"
    return results, [f"{len(affected)} images have detected corners drawn onto them and {consequence}: {names}"]
