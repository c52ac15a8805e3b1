"""A frame of the cameras of a rig."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.features.detection import illuminated_region
from omnisight.geometry.pose import Pose
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


def check_images(rig: Rig, images: Sequence[Bytes]) -> None:
    """Raise ValueError if images do not fit the cameras."""
    if len(images) != len(rig):
        raise ValueError(f"{len(images)} images for {len(rig)} cameras: give one image of each camera")
    for image, camera, name in zip(images, rig.cameras, rig.names, strict=True):
        if image.shape[::-1] != camera.size:
            width, height = image.shape[::-1]
            raise ValueError(
                f"the image of {name} is {width}x{height} px, but its camera {camera.width}x{camera.height}"
            )


def usable_regions(rig: Rig, images: Sequence[Bytes], masks: Sequence[Mask] | None) -> list[Mask]:
    """Return the pixels (H, W) of each image that show the scene and that its mask selects.

    Raises
    ------
    ValueError
        If there are none.
    """
    regions = [illuminated_region(image, camera) for image, camera in zip(images, central_cameras(rig), strict=True)]
    return [masked_region(*each) for each in zip(regions, masks or [None] * len(rig), rig.names, strict=True)]
