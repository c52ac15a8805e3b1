"""Errors of estimated poses after a robust similarity to the true ones."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.sfm.georeference import least_squares_similarity

Array = NDArray[np.float64]

# A pose within these errors, relative to the path and degrees, is correct: others are joined to the wrong place.
MAX_POSITION, MAX_ROTATION_DEG = 0.01, 1.0
# Pairs of poses from which similarities are computed.
MAX_PAIRS = 2000


@dataclass(frozen=True)
class PoseErrors:
    """Number of correct poses, and median errors of positions, relative to the path, and of rotations, degrees."""

    correct: int
    position: float
    rotation_deg: float


def pose_errors(found: Sequence[Pose], true: Sequence[Pose], length: float) -> PoseErrors:
    """Return the errors of poses world_from_rig along a path of a length, metres.

    The similarity is that of the poses that agree with the best pair of poses, so that a part that is joined to the
    wrong place does not change the errors of the others.
    """
    if len(found) < 3:
        return PoseErrors(0, float("nan"), float("nan"))
    a, b = (np.array([pose.translation for pose in each]) for each in (found, true))
    turns = np.array([t.rotation @ f.rotation.T for f, t in zip(found, true, strict=True)])
    agree = _agreeing(a, b, turns, MAX_POSITION * length)
    aligned = least_squares_similarity(a[agree], b[agree])
    position = np.linalg.norm(aligned @ a - b, axis=1) / length
    rotation_deg = np.degrees(np.linalg.norm(so3.log(aligned.rotation @ turns.transpose(0, 2, 1)), axis=1))
    correct = int(((position <= MAX_POSITION) & (rotation_deg <= MAX_ROTATION_DEG)).sum())
    return PoseErrors(correct, float(np.median(position)), float(np.median(rotation_deg)))


def _agreeing(a: Array, b: Array, turns: Array, limit: float) -> NDArray[np.bool_]:
    """Return which positions (N,) agree with the similarity of two poses that most agree with."""
    i, j = np.triu_indices(len(a), 1)
    chosen = np.random.default_rng(0).permutation(len(i))[:MAX_PAIRS]
    best = np.ones(len(a), bool)
    most = 2
    for first, second in zip(i[chosen], j[chosen], strict=True):
        scale = np.linalg.norm(b[second] - b[first]) / max(np.linalg.norm(a[second] - a[first]), 1e-300)
        moved = scale * (a - a[first]) @ turns[first].T + b[first]
        agree = np.linalg.norm(moved - b, axis=1) <= limit
        if agree.sum() > most:
            best, most = agree, int(agree.sum())
    return best
