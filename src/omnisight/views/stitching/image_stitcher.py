"""Stitching of images: sampled with antialiasing, corrected and blended with precomputed maps and weights."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.views.stitching.blending import Blender
from omnisight.views.stitching.sampling import Mask
from omnisight.views.stitching.seam_plan import SeamPlan, label_map

Bytes = NDArray[np.uint8]

# Corrections of colours below half a grey level of 255 are not applied.
MIN_CORRECTION = 0.002


class ImageStitcher:
    """Applies a plan to simultaneous images.

    Attributes
    ----------
    covered
        (H, W) pixels of the sphere that a camera shows.
    """

    def __init__(self, plan: SeamPlan, bearings: NDArray[Any]) -> None:
        """Compute the maps, factors and weights of the directions (H, W, 3) of a sphere."""
        import cv2

        self._maps: list[tuple[Any, Any]] = []
        self._factors: list[Any] = []
        seen: list[Mask] = []
        for k, sampler in enumerate(plan.samplers):
            u, v, mask = sampler.map(bearings)
            seen.append(mask)
            factor = plan.photometry.factor(k, np.minimum(sampler.relative_radius(np.stack([u, v], -1)), 1.0))
            is_small = float(np.abs(factor - 1).max()) < MIN_CORRECTION
            self._factors.append(None if is_small else factor)
            self._maps.append(cv2.convertMaps(u, v, cv2.CV_16SC2))
        self.covered: Mask = np.logical_or.reduce(seen)
        self._blender = Blender(label_map(plan.seams, seen, bearings), seen)

    def __call__(self, images: Sequence[Bytes]) -> Bytes:
        """Stitch images (H, W, 3) of all cameras."""
        import cv2

        layers: list[Any] = []
        for image, (first, second), factor in zip(images, self._maps, self._factors, strict=True):
            layer = cv2.remap(image, first, second, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            layers.append(layer if factor is None else cv2.multiply(layer, factor, dtype=cv2.CV_8U))
        return self._blender(layers)
