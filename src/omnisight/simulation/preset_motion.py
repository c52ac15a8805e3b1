"""Preset motions: a person who walks through the free space of a scene with a camera."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import exp
from omnisight.simulation.trajectory import Trajectory

Array = NDArray[np.float64]
Corner = tuple[float, float, float]
# Positions (N, 3), yaw (N,) and roll (N,) as functions of the share (N,) of the path.
Path = Callable[[Array], tuple[Array, Array, Array]]

PRESETS = ("line", "loop", "still", "turn")
# Comfortable gait of adults (Bohannon 1997), and what a person keeps on curves, when starting and when turning.
MAX_SPEED_M_S, MAX_ACCELERATION_M_S2, MAX_TURN_RATE_RAD_S = 1.4, 0.7, float(np.radians(45))
# Samples of a path for its speed, and time between the poses.
PATH_SAMPLES, TIME_STEP_S = 4001, 0.02


def preset_trajectory(name: str, free: tuple[Corner, Corner], duration: float = 0.0) -> Trajectory:
    """Return a preset motion within a box of free space, at the speed of a walking person.

    Speed, turn rate, and the accelerations along and across the path are limited.

    Parameters
    ----------
    name
        "loop": a closed loop, looking ahead; "line": along the longest side, looking ahead, from rest to rest; "turn":
        rotation in place; "still".
    free
        Low and high corner of the box, metres.
    duration
        Seconds. If the motion is shorter, it is repeated; a line ends at its last pose.

    Raises
    ------
    ValueError
        If the name is unknown.
    """
    if name not in PRESETS:
        raise ValueError(f"unknown trajectory {name!r}; choose one of: {', '.join(PRESETS)}")
    low, high = np.array(free, float)
    middle, half = (low + high) / 2, (high - low) / 2
    paths: dict[str, Path] = {
        "loop": lambda share: _loop(share, middle, half),
        "line": lambda share: _line(share, middle, half),
        "turn": lambda share: (np.tile(middle, (len(share), 1)), 2 * np.pi * share, 0 * share),
        "still": lambda share: (np.tile(middle, (len(share), 1)), 0 * share, 0 * share),
    }
    share_at = _share_by_time(paths[name], closed=name != "line")
    end = float(share_at.x[-1])
    times = np.linspace(0, end, max(int(np.ceil(end / TIME_STEP_S)), 1) + 1)
    poses = [
        Pose(exp(np.array((0, yaw, 0))) @ exp(np.array((0, 0, roll))), place)
        for place, yaw, roll in zip(*paths[name](share_at(times)), strict=True)
    ]
    rounds = 1 if name == "line" else max(int(np.ceil(duration / end)), 1)
    repeated = [times[1:] + k * end for k in range(rounds)]
    return Trajectory(np.concatenate([times[:1], *repeated]), (poses[0], *poses[1:] * rounds))


def _loop(share: Array, middle: Array, half: Array) -> tuple[Array, Array, Array]:
    """Return an ellipse in the box; height and roll vary, as for a hand-held camera."""
    turn = 2 * np.pi * share
    places = middle + half * np.stack([-np.cos(turn), 0.3 * np.sin(2 * turn), np.sin(turn)], -1)
    heading = np.unwrap(np.arctan2(half[0] * np.sin(turn), half[2] * np.cos(turn)))
    return places, heading, 0.06 * np.sin(2 * turn + 0.7)


def _line(share: Array, middle: Array, half: Array) -> tuple[Array, Array, Array]:
    """Return a line along the longest side of the box."""
    along = half * (np.arange(3) == np.argmax(half))
    places = middle + (2 * share[:, None] - 1) * along
    return places, np.full(len(share), np.arctan2(along[0], along[2])), 0.03 * np.sin(6 * np.pi * share)


def _share_by_time(path: Path, *, closed: bool) -> CubicHermiteSpline:
    """Return the share of a path that a person has walked as a function of time, seconds."""
    share = np.linspace(0, 1, PATH_SAMPLES)
    places, heading, _ = path(share)
    length, turn = np.linalg.norm(np.diff(places, axis=0), axis=1), np.abs(np.diff(heading))
    if length.sum() == 0:  # on the spot
        seconds = max(float(turn.sum()) / MAX_TURN_RATE_RAD_S, 1.0)
        return CubicHermiteSpline(seconds * share, share, np.full(PATH_SAMPLES, 1 / seconds))
    bend = turn / length
    with np.errstate(divide="ignore"):
        limits = [MAX_TURN_RATE_RAD_S / bend, np.sqrt(MAX_ACCELERATION_M_S2 / bend)]
    highest = np.minimum(np.minimum(*limits), MAX_SPEED_M_S)
    speed = _accelerated(highest, length, closed=closed)
    times = np.concatenate([[0], np.cumsum(2 * length / (speed[:-1] + speed[1:]))])
    walked = np.concatenate([[0], np.cumsum(length)])
    return CubicHermiteSpline(times, share, speed / np.gradient(walked, share))


def _accelerated(highest: Array, length: Array, *, closed: bool) -> Array:
    """Return the speed (N + 1,) between segments (N,) of limited speed with limited acceleration."""
    speed = np.minimum(np.append(highest, highest[-1]), np.insert(highest, 0, highest[0]))
    if closed:
        speed[0] = speed[-1] = min(speed[0], speed[-1])
    else:
        speed[0] = speed[-1] = 0.0
    # Twice, because the end of a closed path limits its start.
    for _ in range(2 if closed else 1):
        for order in (range(len(length)), range(len(length) - 1, -1, -1)):
            for i in order:
                near, far = (i, i + 1) if order.step > 0 else (i + 1, i)
                speed[far] = min(speed[far], np.sqrt(speed[near] ** 2 + 2 * MAX_ACCELERATION_M_S2 * length[i]))
        if closed:
            speed[0] = speed[-1] = min(speed[0], speed[-1])
    return speed
