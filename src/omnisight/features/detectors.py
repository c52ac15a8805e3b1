"""The detectors of OpenCV: keypoints and descriptors of a gray image."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Smallest contrast of keypoints of SIFT; COLMAP's.
SIFT_CONTRAST = 0.02
# Width of the patch of ORB's descriptor at the finest level, OpenCV's default.
ORB_PATCH_PX = 31


class RawKeypoints(NamedTuple):
    """Keypoints in a gray image.

    Attributes
    ----------
    pixels
        (N, 2).
    radius
        (N,) px, see `Keypoints.scale`.
    response
        (N,) strength.
    descriptors
        (N, D).
    """

    pixels: Array
    radius: Array
    response: Array
    descriptors: NDArray[Any]

    def select(self, mask: NDArray[np.bool_]) -> "RawKeypoints":
        """Return the keypoints of a mask (N,)."""
        return RawKeypoints(*(values[mask] for values in self))


@dataclass(frozen=True)
class Detector:
    """A detector with descriptor.

    Attributes
    ----------
    kind
        "sift" or "orb".
    support
        Radius of the region that a descriptor describes, in radii of the keypoint.
    sigma
        Standard deviation of a coordinate: a constant (px) and a share of the radius, added in quadrature.
    """

    kind: str
    support: float
    sigma: tuple[float, float]

    def sigma_px(self, radius: Array) -> Array:
        """Return the standard deviation (N,), px, of the coordinates of keypoints with a radius (N,)."""
        return np.hypot(self.sigma[0], self.sigma[1] * radius)

    def __call__(self, gray: NDArray[np.uint8], mask: NDArray[np.uint8], count: int) -> RawKeypoints:
        """Detect keypoints where a mask (H, W) is not 0, at least the `count` strongest of them."""
        import cv2 as typed_cv2

        cv2: Any = typed_cv2  # the stubs of OpenCV 5 lack the detectors
        if self.kind == "sift":
            # Without precise upscaling, keypoints are displaced by a quarter of a pixel.
            opencv = cv2.SIFT_create(0, contrastThreshold=SIFT_CONTRAST, enable_precise_upscale=True)
        else:
            # OpenCV would exclude a border of 31 px at each level; callers know where the image ends.
            opencv = cv2.ORB_create(count, edgeThreshold=1, patchSize=ORB_PATCH_PX)
        found, descriptors = opencv.detectAndCompute(gray, mask)
        if not found:
            descriptors = np.zeros((0, opencv.descriptorSize()), np.float32 if self.kind == "sift" else np.uint8)
        values = np.array([(*k.pt, k.size, k.response) for k in found], float).reshape(-1, 4)
        radius = values[:, 2] / (2.0 if self.kind == "sift" else ORB_PATCH_PX)
        return RawKeypoints(values[:, :2], radius, values[:, 3], self._normalize(descriptors))

    def _normalize(self, descriptors: NDArray[Any]) -> NDArray[Any]:
        """Return descriptors of SIFT as RootSIFT (Arandjelovic and Zisserman 2012), other descriptors as they are."""
        if self.kind != "sift":
            return descriptors
        total = np.maximum(descriptors.sum(1, keepdims=True), np.finfo(np.float32).tiny)
        return np.sqrt(descriptors / total).astype(np.float32)


# The standard deviations are those of a normal distribution with the 90 % quantile of the errors on rendered pairs.
# Most of that of ORB is the rounding to pixels of the level, 1/sqrt(12) of the radius.
DETECTORS = {
    "sift": Detector("sift", support=6.0, sigma=(0.11, 0.1)),
    "orb": Detector("orb", support=ORB_PATCH_PX / 2, sigma=(0.0, 0.34)),
}
