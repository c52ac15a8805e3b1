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
# Median angle (radians) between the relative rotations in all images up to which they are constant, and median distance
# of the relative positions, relative to that of the board. The pose of one board is known to about a degree; without a
# relation, rotations of boards differ by tens of degrees. Rotations alone do not show mirror images: those of a second
# board, parallel to the first at the opposite wall, are the same.
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
    """Return the pairs of cameras whose relative pose is constant only if the images of one are mirrored."""
    found = list[MirroredPair]()
    for i, a in enumerate(sightings):
        for j in range(i + 1, len(sightings)):
            b = sightings[j]
            groups, at_a, at_b = np.intersect1d(a.group, b.group, return_indices=True)
            if len(groups) < MIN_COMMON_GROUPS:
                continue
            first, second = a.at(at_a), b.at(at_b)
            if _scatter(_rotations(first, second, np.eye(3), np.eye(3))) <= MAX_SCATTER_RAD:
                continue
            if _is_rigid(first, second, FLIP, FROM_BEHIND):
                pose = second.cam_from_group
                behind = np.einsum("vi,vi->v", pose.rotation[:, :, 2], pose.translation)
                found.append(MirroredPair(i, j, j if np.median(behind) < 0 else i))
            elif any(_is_rigid(first, second, FLIP, turn) for turn in RENUMBERED):
                found.append(MirroredPair(i, j, None))
    return found


def mirrored_cameras(pairs: Sequence[MirroredPair]) -> tuple[int, ...]:
    """Return the cameras with mirror images: those known, or in all of several pairs; both cameras of a single pair."""
    known = {pair.mirrored for pair in pairs if pair.mirrored is not None}
    open_pairs = [{pair.a, pair.b} for pair in pairs if pair.mirrored is None]
    common = set[int].intersection(*open_pairs) if open_pairs else set[int]()
    return tuple(sorted(known or common or {camera for pair in open_pairs for camera in pair}))


def _is_rigid(a: Sightings, b: Sightings, flip: Array, turn: Array) -> bool:
    """Return whether the pose of b relative to a is constant, if `flip` undoes its images and `turn` its boards."""
    rotations = _rotations(a, b, flip, turn)
    middle_a, middle_b = (side.cam_from_group.transformed(side.middle[:, None])[:, 0] for side in (a, b))
    positions = middle_b @ flip.T - np.einsum("vij,vj->vi", rotations, middle_a)
    distances = np.linalg.norm(positions[:, None] - positions, axis=2)
    reach = MAX_SCATTER_RAD * np.median(np.linalg.norm(middle_a, axis=1))
    return _scatter(rotations) <= MAX_SCATTER_RAD and bool(np.median(distances, axis=1).min() <= reach)


def _rotations(a: Sightings, b: Sightings, flip: Array, turn: Array) -> Array:
    """Return the rotations (N, 3, 3) of b relative to a, if `flip` undoes its images and `turn` its boards."""
    return flip @ b.cam_from_group.rotation @ turn @ np.swapaxes(a.cam_from_group.rotation, 1, 2)


def _scatter(rotations: Array) -> float:
    """Return the median angle (radians) of rotations (N, 3, 3) from the one that is nearest to most."""
    between = np.einsum("aij,bkj->abik", rotations, rotations)
    angles = np.linalg.norm(so3.log(between.reshape(-1, 3, 3)), axis=1).reshape(len(rotations), -1)
    return float(np.median(angles, axis=1).min())
