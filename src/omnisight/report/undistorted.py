"""Undistorted copies of the images of a calibration."""

import math
from typing import Any

from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.images import to_gray8
from omnisight.pipeline.views.view_options import ViewOptions
from omnisight.pipeline.views.view_target import view_target
from omnisight.views.remapper import Remapper

# Perspective stretches the corners of a wider view more than fourfold.
MAX_PERSPECTIVE_DEG = 120.0


class Undistortion:
    """The undistorted view of a camera's images: perspective, or a cylinder for a mirror camera."""

    def __init__(self, camera: Camera, width: int) -> None:
        """Prepare views of a width, px."""
        fov = min(MAX_PERSPECTIVE_DEG, 2 * math.degrees(camera.theta_max or math.pi / 4))
        size = width, max(1, round(width * camera.height / camera.width))
        options = ViewOptions(fov=None if camera.theta_min > 0 else fov, size=size).for_camera(camera)
        target, (rotation,) = view_target(options)
        self.source_size = camera.size
        self.description = (
            "a cylinder, in which vertical edges are straight"
            if options.to == "cylinder"
            else f"a perspective view of {fov:.0f}°, in which straight edges are straight"
        )
        self._remap = Remapper(camera, target, rotation)

    def __call__(self, image: NDArray[Any]) -> NDArray[Any]:
        """Return the view (height, width) or (height, width, 3) of an image, with 8 bits."""
        return self._remap(image if image.dtype == "uint8" else to_gray8(image))
