"""A map for localization: a reconstruction whose points have the descriptors of their observations."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from omnisight.display import Displayed
from omnisight.features import Keypoints
from omnisight.places import PlaceIndex
from omnisight.sfm.reconstruction import Reconstruction

Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class VisualMap(Displayed):
    """A reconstruction with the descriptors of its observations.

    Attributes
    ----------
    reconstruction
        Poses, points and observations.
    descriptors
        (M, D) float32 unit descriptors of the M observations.
    """

    reconstruction: Reconstruction
    descriptors: NDArray[np.float32] = field(repr=False)

    @cached_property
    def rows(self) -> list[Indices]:
        """The observations of each image."""
        order = np.argsort(self.reconstruction.observations.image, kind="stable")
        counts = np.bincount(self.reconstruction.observations.image, minlength=len(self.reconstruction))
        return np.split(order, np.cumsum(counts)[:-1])

    @cached_property
    def index(self) -> PlaceIndex:
        """Index of the images by their descriptors."""
        index = PlaceIndex()
        for rows in self.rows:
            index.add(_keypoints(self.descriptors[rows]))
        return index

    @property
    def longest_track(self) -> tuple[int, float]:
        """Largest number of images that show one point, and largest angle (degrees) between its bearings.

        The bearings are in the frames of the cameras: 180° is a point that was ahead, and then behind.
        """
        model = self.reconstruction
        seen = model.observations
        if not len(seen):
            return 0, 0.0
        images = np.bincount(seen.point, minlength=len(model.points))
        poses = [model.cam_from_world(i) for i in range(len(model))]
        rotations, translations = np.array([p.rotation for p in poses]), np.array([p.translation for p in poses])
        at = np.einsum("mij,mj->mi", rotations[seen.image], model.points.position[seen.point])
        bearings = at + translations[seen.image]
        bearings /= np.linalg.norm(bearings, axis=1, keepdims=True)
        order = np.argsort(seen.point, kind="stable")
        widest = 0.0
        for rows in np.split(order, np.flatnonzero(np.diff(seen.point[order])) + 1):
            widest = max(widest, float(np.arccos(np.clip((bearings[rows] @ bearings[rows].T).min(), -1, 1))))
        return int(images.max()), float(np.degrees(widest))


def _keypoints(descriptors: NDArray[np.float32]) -> Keypoints:
    """Return keypoints with descriptors only."""
    count = len(descriptors)
    return Keypoints(np.zeros((count, 2)), np.zeros((count, 3)), np.zeros((count, 3, 3)), np.zeros(count), descriptors)
