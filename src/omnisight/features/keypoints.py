"""Keypoints of an image: pixels, bearings, their covariances, and descriptors."""

from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from omnisight.display import Displayed

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Keypoints(Displayed):
    """Keypoints of an image, the strongest first.

    `keypoints[indices]` selects some of them, for example those of matches.

    Attributes
    ----------
    pixels
        (N, 2) in the image.
    bearings
        (N, 3) unit vectors in the camera frame.
    covariance
        (N, 3, 3) covariance of the bearings, rad², in their tangent planes: rank 2.
    scale
        (N,) radius of the keypoint, radians: the standard deviation of the Gaussian at which it was detected.
    descriptors
        (N, D): float32 of unit length (SIFT), or uint8 with 8 bits each (ORB).
    """

    pixels: Array
    bearings: Array
    covariance: Array
    scale: Array
    descriptors: NDArray[Any]

    def __len__(self) -> int:
        return len(self.pixels)

    def __getitem__(self, indices: Any) -> Self:
        """Return the keypoints of an index array, a mask or a slice."""
        return type(self)(**{field.name: getattr(self, field.name)[indices] for field in fields(self)})

    def __repr__(self) -> str:
        sigma = np.degrees(np.sqrt(np.trace(self.covariance, axis1=-2, axis2=-1) / 2))
        accuracy = f", {np.median(sigma):.3f} degrees (1σ)" if len(self) else ""
        return f"Keypoints({len(self)}{accuracy}, descriptors {self.descriptors.dtype} x {self.descriptors.shape[1]})"


def concatenate(parts: list[Keypoints]) -> Keypoints:
    """Join keypoints of one kind of descriptor; the list must not be empty."""
    return Keypoints(**{f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Keypoints)})
