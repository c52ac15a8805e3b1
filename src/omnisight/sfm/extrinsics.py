"""Poses of the sensors of a rig from a map that treats its cameras as independent."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.sfm.mapping import Map

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Rounds of the geometric median of poses.
ROUNDS = 20


def estimate_extrinsics(found: Map, frame: Indices) -> tuple[Array, Indices]:
    """Estimate the poses of the sensors of a rig from the poses of independent images.

    Parameters
    ----------
    found
        A map in which each image is a frame of its own.
    frame
        (I,) index of the time at which each image was taken.

    Returns
    -------
    sensor_from_rig
        (S, 3, 4), in the unit of the map: the first sensor that is in the map is the rig's frame, and sensors that no
        common time connects with it are NaN.
    used
        Number of times (S,) that connect each sensor with one that is known.
    """
    pose_of = dict(zip(found.frames.tolist(), found.rig_from_world, strict=True))
    images = found.images
    taken = [dict[int, Pose]() for _ in images.sensor_from_rig]  # of each sensor, by time
    for image, pose in pose_of.items():
        taken[images.sensor[image]][int(frame[image])] = Pose.of_matrix(pose)
    reference = next(s for s, poses in enumerate(taken) if poses)
    known, used = {reference: Pose()}, np.zeros(len(taken), np.intp)
    while True:
        links = [
            (len(taken[s].keys() & taken[k].keys()), s, k) for s in range(len(taken)) if s not in known for k in known
        ]
        count, s, k = max(links, default=(0, 0, 0))
        if not count:
            break
        common = taken[s].keys() & taken[k].keys()
        known[s] = _median([taken[s][t] @ taken[k][t].inverse() for t in sorted(common)]) @ known[k]
        used[s] = count
    unknown = Pose(np.full((3, 3), np.nan), np.full(3, np.nan))
    return np.array([known.get(s, unknown).matrix for s in range(len(taken))]), used


def _median(poses: Sequence[Pose]) -> Pose:
    """Return the geometric medians of rotations and of translations (Weiszfeld's algorithm)."""
    rotations = np.array([pose.rotation for pose in poses])
    translations = np.array([pose.translation for pose in poses])
    rotation, translation = rotations[0], translations[0]
    for _ in range(ROUNDS):
        turns, shifts = so3.log(rotations @ rotation.T), translations - translation
        rotation = so3.exp(_weighted_mean(turns)) @ rotation
        translation = translation + _weighted_mean(shifts)
    return Pose(rotation, translation)


def _weighted_mean(vectors: Array) -> Array:
    """Return the mean of vectors (N, 3), weighted by their inverse lengths."""
    weights = 1 / np.maximum(np.linalg.norm(vectors, axis=1), 1e-9)
    return weights @ vectors / weights.sum()
