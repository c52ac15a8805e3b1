"""Tracked patches of the tangent plane, with their templates."""

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.visual_odometry.image_pyramid import LEVELS

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Patches:
    """Tracked patches, sorted by their number.

    Attributes
    ----------
    number
        (N,) increasing, never used twice.
    sensor
        (N,) index of the camera.
    pixels
        (N, 2) last measured position.
    points
        (N, 3) in the world; NaN while their distance is unknown.
    directions
        (N, 3) last measured directions in the world.
    tangents
        (N, 3, 2) directions of the axes of the patch in the world, radians per unit of the patch.
    centers
        (N, 3) position of the camera in the world when the template was taken.
    texture
        (N,) rows of `Textures`.
    uncertainty
        (N, 2, 2) covariance of the last position, square units of the patch, over the variance of the intensities.
    noise
        (N,) root mean square difference of the intensities at the last alignment.
    slopes
        (N, 2) change of the inverse distance from the centre of the template per unit of the patch, over the inverse
        distance.
    guesses
        (N, 3) assumed points of patches whose distance is unknown; NaN for all others.
    is_seen
        (N,) whether the last image shows it.
    """

    number: Indices
    sensor: Indices
    pixels: Array
    points: Array
    directions: Array
    tangents: Array
    centers: Array
    texture: Indices
    uncertainty: Array
    noise: Array
    slopes: Array
    guesses: Array
    is_seen: Mask

    @classmethod
    def none(cls) -> "Patches":
        """Return no patches."""
        return cls(
            np.zeros(0, np.intp),
            np.zeros(0, np.intp),
            np.zeros((0, 2)),
            np.zeros((0, 3)),
            np.zeros((0, 3)),
            np.zeros((0, 3, 2)),
            np.zeros((0, 3)),
            np.zeros(0, np.intp),
            np.zeros((0, 2, 2)),
            np.zeros(0),
            np.zeros((0, 2)),
            np.zeros((0, 3)),
            np.zeros(0, np.bool_),
        )

    def __len__(self) -> int:
        return len(self.number)

    def __getitem__(self, use: Mask | Indices) -> "Patches":
        """Return some of the patches, in the same order; without a copy if a mask selects all."""
        if use.dtype == np.bool_ and use.all():
            return self
        return replace(self, **{field.name: getattr(self, field.name)[use] for field in fields(self)})

    def joined(self, others: "Patches") -> "Patches":
        """Return these patches and others with larger numbers."""
        return Patches(*(np.concatenate([getattr(self, f.name), getattr(others, f.name)]) for f in fields(self)))

    @property
    def has_point(self) -> Mask:
        """Whether the distance of each is known."""
        return np.isfinite(self.points[:, 0])

    def rows_of(self, numbers: Indices) -> tuple[Indices, Mask]:
        """Return the rows (K,) of numbers (K,), and which of them exist."""
        rows = np.minimum(np.searchsorted(self.number, numbers), max(len(self) - 1, 0))
        exists = self.number[rows] == numbers if len(self) else np.zeros(len(numbers), np.bool_)
        return rows, exists

    def view_changes(self, center: Array) -> Array:
        """Return the angles (N,) between the directions of points from a camera, and from that of the template."""
        now, then = self.points - center, self.points - self.centers
        lengths = np.linalg.norm(now, axis=1) * np.linalg.norm(then, axis=1)
        cosine = (now * then).sum(axis=1) / np.maximum(lengths, 1e-300)
        return np.arccos(np.clip(np.where(self.has_point, cosine, 1.0), -1.0, 1.0))


class Textures:
    """What patches look like, in the rows of arrays: selections of patches copy only the indices of their rows.

    Attributes
    ----------
    templates, gradients, inverses, affine, usable
        See `_patch_kernel.extract`.
    """

    def __init__(self) -> None:
        """Start without rows."""
        from omnisight.visual_odometry._patch_kernel import SAMPLES

        self.templates: Floats = np.zeros((0, LEVELS, SAMPLES), np.float32)
        self.gradients: Floats = np.zeros((0, LEVELS, SAMPLES, 2), np.float32)
        self.inverses: Array = np.zeros((0, LEVELS, 2, 2))
        self.affine: Floats = np.zeros((0, SAMPLES, 6), np.float32)
        self.usable: Mask = np.zeros((0, LEVELS), np.bool_)

    @property
    def arrays(self) -> tuple[Floats, Floats, Array, Floats, Mask]:
        """What `_patch_kernel.extract` fills."""
        return self.templates, self.gradients, self.inverses, self.affine, self.usable

    def free_rows(self, count: int, used: Indices) -> Indices:
        """Return rows (count,) that are not among those used; the arrays grow if there are too few."""
        is_free = np.ones(len(self.usable), np.bool_)
        is_free[used] = False
        rows = np.flatnonzero(is_free)[:count]
        if len(rows) < count:
            more = max(count - len(rows), len(self.usable))
            rows = np.append(rows, np.arange(len(self.usable), len(self.usable) + count - len(rows)))
            for name, values in vars(self).copy().items():
                setattr(self, name, np.concatenate([values, np.zeros((more, *values.shape[1:]), values.dtype)]))
        return rows
