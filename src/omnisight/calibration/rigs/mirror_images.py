"""Cameras whose images are mirrored: no rigid motion relates their board poses to those of the other cameras."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.rigs.sightings import Sightings
from omnisight.geometry import rotation as so3

Array = NDArray[np.float64]

# The relative rotation of two images is free: with two others that agree, the third is evidence.
MIN_COMMON_GROUPS = 4
# Median angle (radians) between the relative rotations in all images up to which they are constant. The pose of one
# board is known to about a degree; without a relation, rotations of boards differ by tens of degrees.
MAX_SCATTER_RAD = np.radians(3.0)
# A mirror image of a camera.
FLIP = np.diag([-1.0, 1.0, 1.0])
# What it does to a board: its corners are numbered from the other side, along x or y; with markers, which are numbered
# as on the print, the board is seen from behind.
RENUMBERED = (np.diag([-1.0, 1.0, 1.0]), np.diag([1.0, -1.0, 1.0]))
FROM_BEHIND = np.diag([1.0, 1.0, -1.0])


@dataclass(frozen=True)
class MirroredPair:
    """Two cameras, one of them with mirror images.

    Attributes
    ----------
    a, b
        Indices of the cameras.
    mirrored
        The one with mirror images; None if it could be either.
    """

    a: int
    b: int
    mirrored: int | None


def find_mirrored_pairs(sightings: Sequence[Sightings]) -> list[MirroredPair]:
    """Return the pairs of cameras whose relative rotation is constant only if the images of one are mirrored."""
    found = list[MirroredPair]()
    for i, a in enumerate(sightings):
        for j in range(i + 1, len(sightings)):
            b = sightings[j]
            groups, at_a, at_b = np.intersect1d(a.group, b.group, return_indices=True)
            if len(groups) < MIN_COMMON_GROUPS:
                continue
            first, second = a.at(at_a).cam_from_group, b.at(at_b).cam_from_group
            back = np.swapaxes(first.rotation, 1, 2)
            if _scatter(second.rotation @ back) <= MAX_SCATTER_RAD:
                continue
            if _scatter(FLIP @ second.rotation @ FROM_BEHIND @ back) <= MAX_SCATTER_RAD:
                behind = np.einsum("vi,vi->v", second.rotation[:, :, 2], second.translation)
                found.append(MirroredPair(i, j, j if np.median(behind) < 0 else i))
            elif min(_scatter(FLIP @ second.rotation @ turn @ back) for turn in RENUMBERED) <= MAX_SCATTER_RAD:
                found.append(MirroredPair(i, j, None))
    return found


def mirrored_cameras(pairs: Sequence[MirroredPair]) -> tuple[int, ...]:
    """Return the cameras with mirror images: those known, or in all of several pairs; both cameras of a single pair."""
    known = {pair.mirrored for pair in pairs if pair.mirrored is not None}
    open_pairs = [{pair.a, pair.b} for pair in pairs if pair.mirrored is None]
    common = set[int].intersection(*open_pairs) if open_pairs else set[int]()
    return tuple(sorted(known or common or {camera for pair in open_pairs for camera in pair}))


def _scatter(rotations: Array) -> float:
    """Return the median angle (radians) of rotations (N, 3, 3) from the one that is nearest to most."""
    between = np.einsum("aij,bkj->abik", rotations, rotations)
    angles = np.linalg.norm(so3.log(between.reshape(-1, 3, 3)), axis=1).reshape(len(rotations), -1)
    return float(np.median(angles, axis=1).min())
