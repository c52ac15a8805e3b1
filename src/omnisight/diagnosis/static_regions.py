"""Regions that look the same in all images of a moving camera: the vehicle, a tripod, dirt on the lens."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Mask = NDArray[np.bool_]

# Width (px) to which images are reduced.
WIDTH_PX = 480
# Side (px of the reduced image) of the window over which edges are compared.
WINDOW_PX = 9
# Images that are compared at least.
MIN_IMAGES = 8
# Length of the mean gradient over the mean length: 1 for edges that stay, 1/sqrt(N) for those of N unrelated images, up
# to 0.84 for 99 % of the edges of a room in three seconds.
MIN_COHERENCE = 0.88
# Mean gradient (gray levels per px) of a region that has edges.
MIN_GRADIENT = 1.5
# Median coherence of all edges above which the camera does not move enough to compare them.
MAX_MEDIAN_COHERENCE = 0.55
# Share of the image of a region that matters.
MIN_AREA_SHARE = 0.002


class StaticEdges:
    """Accumulates the gradients of images that are far apart in time."""

    def __init__(self, region: Mask) -> None:
        """Start with the pixels (H, W) to use."""
        self._region = region
        self._sum: NDArray[Any] | None = None
        self._length: NDArray[Any] | None = None
        self.images = 0

    def add(self, gray: Bytes) -> None:
        """Add an image (H, W)."""
        import cv2

        small = cv2.resize(gray, self._small_size(), interpolation=cv2.INTER_AREA).astype(np.float32)
        gradient = np.stack(
            [cv2.Sobel(small, cv2.CV_32F, 1, 0, scale=0.125), cv2.Sobel(small, cv2.CV_32F, 0, 1, scale=0.125)]
        )
        length = np.hypot(*gradient)
        self._sum = gradient if self._sum is None else self._sum + gradient
        self._length = length if self._length is None else self._length + length
        self.images += 1

    def find(self) -> Mask | None:
        """Return the static pixels (H, W); None if the images are too few or the camera does not move enough."""
        import cv2

        if self._sum is None or self._length is None or self.images < MIN_IMAGES:
            return None
        window = (WINDOW_PX, WINDOW_PX)
        along = cv2.blur(np.hypot(*self._sum), window) / self.images
        total = cv2.blur(self._length, window) / self.images
        region = cv2.resize(self._region.astype(np.uint8), self._small_size(), interpolation=cv2.INTER_NEAREST)
        inner = cv2.erode(region, np.ones((2 * WINDOW_PX + 1,) * 2, np.uint8), borderValue=0) > 0
        has_edges = inner & (total > MIN_GRADIENT)
        coherence = along / np.maximum(total, 1e-6)
        if not has_edges.any() or np.median(coherence[has_edges]) > MAX_MEDIAN_COHERENCE:
            return None
        static = (has_edges & (coherence > MIN_COHERENCE)).astype(np.uint8)
        static = cv2.morphologyEx(static, cv2.MORPH_CLOSE, np.ones((2 * WINDOW_PX + 1,) * 2, np.uint8))
        static = cv2.dilate(_large(static, MIN_AREA_SHARE * float(region.sum())), np.ones(window, np.uint8))
        height, width = self._region.shape
        return np.asarray(cv2.resize(static, (width, height), interpolation=cv2.INTER_NEAREST) > 0, np.bool_)

    def _small_size(self) -> tuple[int, int]:
        height, width = self._region.shape
        scale = min(WIDTH_PX / width, 1.0)
        return max(round(width * scale), 1), max(round(height * scale), 1)


def _large(static: NDArray[Any], area: float) -> Bytes:
    """Return the connected parts of a mask (H, W) with at least an area."""
    import cv2

    count, labels, stats, _ = cv2.connectedComponentsWithStats(static)
    large = [k for k in range(1, count) if stats[k, cv2.CC_STAT_AREA] >= area]
    return np.isin(labels, large).astype(np.uint8)
