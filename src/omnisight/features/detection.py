"""Detection of keypoints in the image of any camera."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from omnisight.array_kinds import to_numpy
from omnisight.camera import Camera
from omnisight.choices import Options
from omnisight.features.detection_views import (
    DetectionView,
    MirroredView,
    distance_to_invalid,
    pixel_grid,
    tangent_views,
    valid_region,
    whole_image,
)
from omnisight.features.detectors import DETECTORS, Detector
from omnisight.features.keypoints import Keypoints, concatenate
from omnisight.images import estimate_image_field, to_gray8
from omnisight.parallel import parallel_map

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Share of the pixels that are darker than what becomes white.
WHITE_QUANTILE = 0.995


@dataclass(frozen=True)
class FeatureOptions(Options):
    """How keypoints are detected.

    Attributes
    ----------
    kind
        "sift": accurate and distinctive. "orb": binary descriptors. "xfeat": learned, needs `omnisight[learned]`.
    surface
        "views": stereographic views of the faces of a cube, which rectify the image locally. "image": the image itself.
    max_keypoints
        Only the strongest are returned.
    max_resolution
        Pixels per radian at most: an image with more is reduced, which takes less time.
    """

    kind: Literal["sift", "orb", "xfeat"] = "sift"
    surface: Literal["views", "image"] = "views"
    max_keypoints: int = 4000
    max_resolution: float = float("inf")

    def __post_init__(self) -> None:
        """Check the names and the number."""
        super().__post_init__()
        if self.max_keypoints < 1:
            raise ValueError(f"--max-keypoints must be at least 1, got {self.max_keypoints}")
        if not self.max_resolution > 0:
            raise ValueError(f"--max-resolution must be positive, got {self.max_resolution:g}")


def detect_features(
    image: NDArray[Any],
    camera: Camera,
    options: FeatureOptions | None = None,
    *,
    mask: NDArray[Any] | None = None,
    mirrored: bool = False,
) -> Keypoints:
    """Detect keypoints with bearings, covariances and descriptors.

    The image circle limits keypoints with the support of their descriptors: the calibrated field of view of the camera,
    or, if it is unknown, the image circle detected in the image. At the seam of a 360 image keypoints exist once.
    The image of a mirror camera is detected without its reflection, and then matches the image of a lens.

    Parameters
    ----------
    image
        (H, W), (H, W, 3) or (H, W, 4); see `to_gray8`. Arrays of other libraries, such as PyTorch tensors, too.
    camera
        The camera of the image.
    options
        By default SIFT in views.
    mask
        (H, W), not 0 where keypoints are wanted; by default everywhere.
    mirrored
        Describe the mirror images of the keypoints. They match if the frame of the camera is reflected, see
        `flip_frame`.

    Returns
    -------
    The keypoints, the strongest first; none for an image without texture.

    Raises
    ------
    ValueError
        If the size of the image or of the mask differs from that of the camera.
    """
    options = options or FeatureOptions()
    image = np.asarray(to_numpy(image))
    _check_size("image", image, camera)
    if mask is not None:
        mask = np.asarray(to_numpy(mask))
        _check_size("mask", mask, camera)
    gray = to_gray8(image)
    valid = illuminated_region(gray, camera)
    gray, circle = _brightened(gray, valid), None if _has_known_field(camera) else valid
    detector = DETECTORS[options.kind]
    surface = tangent_views if options.surface == "views" else whole_image
    views = surface(camera, options.max_resolution)
    views = [MirroredView(view) for view in views] if mirrored else views
    found = parallel_map(lambda view: _detect_in_view(view, gray, circle, detector, options.max_keypoints), views)
    keypoints, response = concatenate([k for k, _ in found]), np.concatenate([r for _, r in found])
    if mask is not None:
        column, row = np.clip(np.rint(keypoints.pixels).astype(int), 0, np.array(camera.size) - 1).T
        wanted = mask[row, column] != 0
        keypoints, response = keypoints[wanted], response[wanted]
    strongest = np.argsort(-response, kind="stable")[: options.max_keypoints]
    return keypoints[strongest]


def _detect_in_view(
    view: DetectionView, gray: NDArray[np.uint8], circle: Mask | None, detector: Detector, count: int
) -> tuple[Keypoints, Array]:
    """Return the keypoints of a view and their responses, within the image circle (H, W) if the field is not known."""
    clearance = view.clearance if circle is None else distance_to_invalid(view, circle)
    raw = detector.detect(view(gray), np.where(clearance > 1, view.cell, 0).astype(np.uint8), count)
    column, row = np.rint(raw.pixels).astype(int).T
    raw = raw.select(clearance[row, column] >= detector.support * raw.radius)
    located = view.locate(raw.pixels)
    raw, located = raw.select(located.owned), located.select(located.owned)
    d_pixel = located.d_pixel
    gram = d_pixel.transpose(0, 2, 1) @ d_pixel
    scale = raw.radius * np.linalg.det(gram) ** 0.25  # the area that a pixel covers on the sphere is sqrt(det)
    covariance = d_pixel @ d_pixel.transpose(0, 2, 1) * detector.sigma_px(raw.radius)[:, None, None] ** 2
    return Keypoints(located.pixels, located.bearings, covariance, scale, raw.descriptors), raw.response


def _brightened(gray: NDArray[np.uint8], valid: Mask) -> NDArray[np.uint8]:
    """Return a dark image with full contrast: detectors have thresholds in gray levels."""
    import cv2

    shares = np.cumsum(cv2.calcHist([gray], [0], valid.astype(np.uint8), [256], [0, 256]))
    white = int(np.searchsorted(shares, WHITE_QUANTILE * shares[-1]))
    if not 0 < white < 255:
        return gray
    levels = np.minimum(np.rint(np.arange(256) * (255 / white)), 255).astype(np.uint8)
    return np.asarray(cv2.LUT(gray, levels), np.uint8)


def illuminated_region(gray: NDArray[np.uint8], camera: Camera) -> Mask:
    """Return which pixels (H, W) show the scene.

    They are in the calibrated field of view of the camera, or, if it is unknown, in the image circle that is detected.
    """
    if _has_known_field(camera):
        return valid_region(camera)
    return valid_region(camera) & estimate_image_field([gray]).contains(pixel_grid(camera))


def _has_known_field(camera: Camera) -> bool:
    """Return whether the field of view is calibrated, or that of a 360 image."""
    return camera.theta_max is not None or camera.model.period is not None


def _check_size(name: str, array: NDArray[Any], camera: Camera) -> None:
    if array.ndim < 2:
        raise ValueError(f"the {name} must be an array (H, W), got shape {array.shape}")
    height, width = array.shape[:2]
    if (width, height) != camera.size:
        raise ValueError(
            f"the {name} is {width}x{height} px, but the camera {camera.width}x{camera.height}: use the camera of this"
            " image, or scale it (`Camera.scaled`)"
        )
