"""What one frame shows: the rays of patches."""

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class FrameRays:
    """Rays of patches in the frame of the rig.

    Attributes
    ----------
    number
        (N,) numbers of the patches, increasing.
    points
        (N, 3) in the world; NaN where unknown.
    origins, bearings
        (N, 3) of the rays.
    axes
        (N, 2, 3) tangents along which bearings have unit variance and no correlation.
    """

    number: Indices
    points: Array
    origins: Array
    bearings: Array
    axes: Array

    @classmethod
    def none(cls) -> "FrameRays":
        """Return no rays."""
        return cls(np.zeros(0, np.intp), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 2, 3)))

    def __len__(self) -> int:
        return len(self.number)

    def __getitem__(self, use: Mask | Indices) -> "FrameRays":
        return FrameRays(*(getattr(self, field.name)[use] for field in fields(self)))

    def joined(self, others: "FrameRays") -> "FrameRays":
        """Return these rays and others with larger numbers."""
        if not len(others):
            return self
        return FrameRays(*(np.concatenate([getattr(self, f.name), getattr(others, f.name)]) for f in fields(self)))

    def from_one_point(self) -> "FrameRays":
        """Return the rays as those of a central camera."""
        return replace(self, origins=np.zeros_like(self.origins))

    @property
    def variance(self) -> Array:
        """Mean variances (N,) of the bearings along tangents, square radians."""
        return 1.0 / np.maximum(0.5 * (self.axes**2).sum(axis=(1, 2)), 1e-300)

    @property
    def covariance(self) -> Array:
        """Covariances (N, 3, 3) of the bearings, square radians; zero along them."""
        inverse = np.linalg.pinv(self.axes)
        return inverse @ inverse.transpose(0, 2, 1)

    @property
    def has_point(self) -> Mask:
        """Whether the point of each is known."""
        return np.isfinite(self.points[:, 0])


def common(a: FrameRays, b: FrameRays) -> tuple[FrameRays, FrameRays]:
    """Return the rays of the patches that two frames show."""
    _, rows_a, rows_b = np.intersect1d(a.number, b.number, assume_unique=True, return_indices=True)
    return a[rows_a], b[rows_b]
