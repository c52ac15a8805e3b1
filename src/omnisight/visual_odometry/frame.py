"""A frame of the cameras of a rig."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.features.detection import illuminated_region
from omnisight.geometry.pose import Pose
from omnisight.images import to_gray8
from omnisight.images.mask import masked_region
from omnisight.rig import Rig
from omnisight.visual_odometry.central_rig import central_cameras
from omnisight.visual_odometry.ray_observations import FrameRays

Bytes = NDArray[np.uint8]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame: its index, time, gray images of all cameras, and rays of the patches that they show."""

    index: int
    seconds: float
    images: tuple[Bytes, ...]
    predicted: Pose
    rays: FrameRays


def gray_images(given: Any) -> tuple[Bytes, ...]:
    """Return the gray images (H, W) of an image or of a list of them.

    Raises
    ------
    ValueError
        If one is no image.
    """
    images: Sequence[Any] = given if isinstance(given, list | tuple) else [given]
    for image in images:
        if not isinstance(image, np.ndarray):
            raise ValueError(
                f"an image is {type(image).__name__}, not an array (H, W) or (H, W, 3): read it (om.read_image), or"
                " count a frame without images (skip)"
            )
    return tuple(map(to_gray8, images))


def check_sizes(rig: Rig, arrays: Sequence[NDArray[Any]], kind: str) -> None:
    """Raise ValueError if images or masks do not fit the cameras."""
    if len(arrays) != len(rig):
        raise ValueError(f"{len(arrays)} {kind}s for {len(rig)} cameras: give one {kind} of each camera")
    for array, camera, name in zip(arrays, rig.cameras, rig.names, strict=True):
        if array.shape[::-1] != camera.size:
            size = "x".join(map(str, array.shape[::-1]))
            raise ValueError(f"the {kind} of {name} is {size} px, but its camera {camera.width}x{camera.height}")


def check_time(frame: int, seconds: float, before: float | None) -> None:
    """Raise ValueError if the time of a frame is not finite, or not after that of the one before."""
    if not math.isfinite(seconds):
        raise ValueError(f"the time of frame {frame} is {seconds} s: times must be finite")
    if before is not None and not seconds > before:
        raise ValueError(f"the time of frame {frame} is {seconds:.15g} s, not after {before:.15g} s")


def usable_regions(rig: Rig, images: Sequence[Bytes], masks: Sequence[Mask] | None) -> list[Mask]:
    """Return the pixels (H, W) of each image that show the scene and that its mask selects.

    Raises
    ------
    ValueError
        If there are none.
    """
    regions = [illuminated_region(image, camera) for image, camera in zip(images, central_cameras(rig), strict=True)]
    return [masked_region(*each) for each in zip(regions, masks or [None] * len(rig), rig.names, strict=True)]
