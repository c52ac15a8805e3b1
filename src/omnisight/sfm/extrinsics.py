"""Poses of the sensors of a rig from a map that treats its cameras as independent."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.sfm.map import Map

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Rounds of the geometric median of poses: with one wrong sample of three, its error falls below their noise.
ROUNDS = 100
# Distance, radians or units of the map, within which a sample is at the median.
SAME_SAMPLE = 1e-12


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
    """Return the geometric medians of rotations and of translations (Vardi and Zhang 2000)."""
    rotations = np.array([pose.rotation for pose in poses])
    translations = np.array([pose.translation for pose in poses])
    rotation, translation = so3.nearest(rotations.sum(0)), np.median(translations, axis=0)
    for _ in range(ROUNDS):
        rotation = so3.exp(_median_step(so3.log(rotations @ rotation.T))) @ rotation
        translation = translation + _median_step(translations - translation)
    return Pose(rotation, translation)


def _median_step(vectors: Array) -> Array:
    """Return a step (3,) towards the geometric median, from the vectors (N, 3) to all samples.

    Weiszfeld's algorithm stops at any sample that it meets; here it stops there only if the unit vectors to the others
    sum to less than the number of samples that are met.
    """
    lengths = np.linalg.norm(vectors, axis=1)
    is_met = lengths <= SAME_SAMPLE
    if is_met.all():
        return np.zeros(3)
    weights = 1 / lengths[~is_met]
    pull = weights @ vectors[~is_met]
    share = max(0.0, 1 - is_met.sum() / max(float(np.linalg.norm(pull)), np.finfo(float).tiny))
    return share * pull / weights.sum()
