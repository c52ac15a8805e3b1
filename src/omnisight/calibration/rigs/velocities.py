"""Velocity of moving boards, from their poses at neighbouring times."""

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.rigs.poses import Poses
from omnisight.geometry import rotation as so3

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

# Time (s) between two poses above which their difference is no velocity: a hand changes direction within a second.
MAX_INTERVAL_S = 0.5


def velocities(poses: Poses, seconds: Array, used: Bools) -> Array:
    """Return the velocity (G, 6) of each pose, as the step (w, v) of `Pose.moved` per second; 0 where unknown.

    It is that of the parabola through the pose, the previous and the next one.

    Parameters
    ----------
    poses
        Poses of the boards.
    seconds
        (G,) their times.
    used
        (G,) which of them are known.
    """
    found = np.zeros((len(seconds), 6))
    order = np.flatnonzero(used)[np.argsort(seconds[used], kind="stable")]
    for before, at, after in zip(order, order[1:], order[2:], strict=False):
        first, second = seconds[at] - seconds[before], seconds[after] - seconds[at]
        if not (0 < first <= MAX_INTERVAL_S and 0 < second <= MAX_INTERVAL_S):
            continue
        previous, following = _step(poses, before, at) / first, _step(poses, at, after) / second
        found[at] = (second * previous + first * following) / (first + second)
    return found


def _step(poses: Poses, start: int, end: int) -> Array:
    """Return the step (6,) from one pose to another."""
    turn = so3.log(poses.rotation[end] @ poses.rotation[start].T)
    return np.concatenate([turn, poses.translation[end] - poses.translation[start]])
