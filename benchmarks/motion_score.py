"""Errors of trajectories."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.sfm.georeference import least_squares_similarity

# Parts of the path over which the drift is measured, and the number of their starts.
PARTS, STARTS = (0.1, 0.2, 0.3, 0.4, 0.5), 40


@dataclass(frozen=True)
class Errors:
    """Errors of a trajectory: over the path length, as a share; drift as a share, and in degrees per metre."""

    position: float
    drift: float
    drift_deg_per_m: float
    length: float


def errors(found: Sequence[Pose], true: Sequence[Pose]) -> Errors:
    """Compare poses world_from_rig after a similarity."""
    a, b = (np.array([pose.translation for pose in poses]) for poses in (found, true))
    aligned = least_squares_similarity(a, b)
    position = aligned @ a
    path = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(b, axis=0), axis=1))])
    length = float(path[-1])
    rms = float(np.sqrt(((position - b) ** 2).sum(axis=1).mean())) / length
    poses = [Pose(aligned.rotation @ pose.rotation, at) for pose, at in zip(found, position, strict=True)]
    relative: list[tuple[float, float]] = []
    for part in PARTS:
        for i in range(0, len(path), max(len(path) // STARTS, 1)):
            j = int(np.searchsorted(path, path[i] + part * length))
            if j < len(path):
                change = (poses[i].inverse() @ poses[j]).inverse() @ (true[i].inverse() @ true[j])
                step = path[j] - path[i]
                angle = np.degrees(np.linalg.norm(so3.log(change.rotation)))
                relative.append((float(np.linalg.norm(change.translation)) / step, float(angle) / step))
    drift, turn = np.mean(relative, axis=0)
    return Errors(rms, float(drift), float(turn), length)
