"""Stitching of images: sampled with antialiasing, corrected and blended with precomputed maps and weights."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.views.frame_remapper import PyramidMap, pyramid_map
from omnisight.views.stitching.blending import Blender
from omnisight.views.stitching.sampling import Mask, reduction_level
from omnisight.views.stitching.seam_plan import SeamPlan, label_map

Bytes = NDArray[np.uint8]
Floats = NDArray[np.float32]

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
        self._maps: list[_ImageMap] = []
        self._factors: list[Any] = []
        seen: list[Mask] = []
        for k, sampler in enumerate(plan.samplers):
            u, v, mask = sampler.map(bearings)
            seen.append(mask)
            factor = plan.photometry.factor(k, sampler.relative_radius(np.stack([u, v], -1)))
            is_small = float(np.abs(factor - 1).max()) < MIN_CORRECTION
            self._factors.append(None if is_small else factor)
            self._maps.append(_ImageMap(sampler.camera, u, v, mask))
        self.covered: Mask = np.logical_or.reduce(seen)
        self._blender = Blender(label_map(plan.seams, seen, bearings), seen)

    def __call__(self, images: Sequence[Bytes]) -> Bytes:
        """Stitch images (H, W, 3) of all cameras."""
        import cv2

        layers: list[Any] = []
        for image, image_map, factor in zip(images, self._maps, self._factors, strict=True):
            layer = image_map(image)
            layers.append(layer if factor is None else cv2.multiply(layer, factor, dtype=cv2.CV_8U))
        return self._blender(layers)


class _ImageMap:
    """A map of an image (H, W, 3); from a pyramid where the sphere is smaller than the image."""

    def __init__(self, camera: Camera, u: Floats, v: Floats, seen: Mask) -> None:
        import cv2

        self._shape, self._size = u.shape, camera.size
        level = reduction_level(camera, u, v, seen)
        self._map = cv2.convertMaps(u, v, cv2.CV_16SC2) if level is None else pyramid_map(u, v, camera.size, level)

    def __call__(self, image: Bytes) -> Any:
        import cv2

        if not isinstance(self._map, PyramidMap):
            return cv2.remap(image, *self._map, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        channels = [np.empty(self._shape, np.uint8) for _ in range(3)]
        for plane, channel in zip(cv2.split(image), channels, strict=True):
            self._map.sample(plane, self._size, 0, channel)
        return cv2.merge(channels)
