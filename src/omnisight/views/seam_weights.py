"""Weights with which the images of several cameras are blended in one view."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]

# Width of the narrowest transition, px: below, distances between pixels have no meaning.
MIN_FEATHER_PX = 1.0


def seam_weights(resolution: Sequence[Floats], visible: Sequence[Mask], feather_px: float) -> Floats:
    """Return the weights (C, H, W) of C cameras: 0 where a camera sees nothing, and sum 1 where any sees something.

    Each pixel belongs to the camera that resolves it best; seams keep away from the edge of what a camera sees. Across
    the seams, weights change linearly over the width of the feather.

    Parameters
    ----------
    resolution
        For each camera the image pixels per view pixel (H, W), by area.
    visible
        For each camera the view pixels (H, W) that it sees.
    feather_px
        Width of the transition at a seam, view pixels.
    """
    feather = max(feather_px, MIN_FEATHER_PX)
    to_edge = [_distance(mask) for mask in visible]
    score = np.stack(
        [
            np.where(v, r * np.minimum(d / feather, 1.0), -1.0)
            for r, v, d in zip(resolution, visible, to_edge, strict=True)
        ]
    )
    best = score.argmax(axis=0)
    weights = np.zeros(score.shape, np.float32)
    for k, mask in enumerate(visible):
        own = (best == k) & mask
        if own.any():
            across = np.clip((_distance(own) - _distance(~own)) / feather + 0.5, 0.0, 1.0)
            weights[k] = np.where(mask, np.minimum(across, 2 * to_edge[k] / feather), 0.0)
    total = weights.sum(axis=0)
    return np.divide(weights, total, out=weights, where=total > 0)


def _distance(mask: Mask) -> Any:
    """Return the distance (H, W) of set pixels to the next one that is not set; the edge of the view does not count."""
    import cv2

    return cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
