"""Results of the renderer."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RenderedImage:
    """A rendered image.

    Attributes
    ----------
    image
        (H, W, 3) uint8 RGB.
    corners
        For each board the exact pixels (N, 2) of its points, in the order of `Board.points`.
    """

    image: NDArray[np.uint8]
    corners: tuple[Array, ...]


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """Ground truth at the pixel centres; NaN, and instance 0, for sky or nothing.

    Attributes
    ----------
    depth
        (H, W) metres along the bearing, from the ray's origin.
    normals
        (H, W, 3) unit vectors in the camera frame, towards the camera.
    instances
        (H, W), 1 + the index in `Scene.names`.
    points
        (H, W, 3) in the world frame.
    """

    depth: Array
    normals: Array
    instances: NDArray[np.int32]
    points: Array
