"""Weights with which the images of several cameras are blended in one view."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]


def seam_weights(resolution: Sequence[Floats], visible: Sequence[Mask], feather_px: float) -> Floats:
    """Return the weights (C, H, W) of C cameras: 0 where a camera sees nothing, and sum 1 where any sees something.

    Each pixel belongs to the camera that resolves it best. Across the seams between these regions, weights change
    linearly over the width of the feather; they also fall to zero at the edge of what a camera sees.

    Parameters
    ----------
    resolution
        For each camera the image pixels per view pixel (H, W), by area.
    visible
        For each camera the view pixels (H, W) that it sees.
    feather_px
        Width of the transition at a seam, view pixels.
    """
    import cv2

    score = np.stack([np.where(v, r, -1.0) for r, v in zip(resolution, visible, strict=True)])
    best = score.argmax(axis=0)
    weights = np.zeros(score.shape, np.float32)
    half = max(feather_px, 1e-3) / 2
    for k, mask in enumerate(visible):
        own = (best == k) & mask
        if not own.any():
            continue
        inside = cv2.distanceTransform(own.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        outside = cv2.distanceTransform((~own).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        # The edge of the view is no seam; the distance transform does not count it as one either.
        to_edge = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        across = np.clip((inside - outside) / (2 * half) + 0.5, 0.0, 1.0)
        weights[k] = np.where(mask, np.minimum(across, to_edge / half), 0.0)
    total = weights.sum(axis=0)
    return np.divide(weights, total, out=weights, where=total > 0)
