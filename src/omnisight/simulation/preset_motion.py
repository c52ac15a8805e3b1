"""Preset motions: a person who walks through the free space of a scene with a camera, or a route through the scene."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, CubicHermiteSpline

from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import exp
from omnisight.simulation.trajectory import Trajectory

Array = NDArray[np.float64]
Corner = tuple[float, float, float]
# Positions (N, 3), yaw (N,) and roll (N,) as functions of the share (N,) of the path.
Path = Callable[[Array], tuple[Array, Array, Array]]

PRESETS = ("line", "loop", "still", "turn")
# Samples of a path for its speed, and time between the poses.
PATH_SAMPLES, TIME_STEP_S = 4001, 0.02
# Time between the control points of the motion along a route.
CONTROL_STEP_S = 0.5


class Pace(NamedTuple):
    """Limits of a motion: speed (m/s), acceleration along and across the path (m/s^2) and turn rate (rad/s)."""

    speed: float
    acceleration: float
    turn_rate: float


# Comfortable gait of adults (Bohannon 1997), and what a person keeps on curves, when starting and when turning.
WALK = Pace(1.4, 0.7, float(np.radians(45)))
# A car in a town: 30 km/h, and the acceleration that passengers find comfortable.
DRIVE = Pace(8.0, 2.0, float(np.radians(45)))


@dataclass(frozen=True)
class Route:
    """A closed path through a scene.

    Attributes
    ----------
    points
        Corners of the path, metres, in the order of the motion.
    rounding
        Distance, metres, between the control points of the B-spline that rounds the corners: their least radius is 0.35
        of it, if the path turns by 90 degrees.
    pace
        Limits of the motion.
    """

    points: tuple[Corner, ...]
    rounding: float
    pace: Pace


def preset_trajectory(
    name: str, free: tuple[Corner, Corner], duration: float = 0.0, route: Route | None = None
) -> Trajectory:
    """Return a preset motion within a box of free space, at the speed of a walking person, or along a route.

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
    route
        The path of the loop, instead of a loop in the box. The camera looks along its motion, uphill and downhill too,
        and its position is twice continuously differentiable over time.

    Raises
    ------
    ValueError
        If the name is unknown.
    """
    if name not in PRESETS:
        raise ValueError(f"unknown trajectory {name!r}; choose one of: {', '.join(PRESETS)}")
    if name == "loop" and route is not None:
        return _repeated(_route_trajectory(route), duration)
    low, high = np.array(free, float)
    middle, half = (low + high) / 2, (high - low) / 2
    paths: dict[str, Path] = {
        "loop": lambda share: _loop(share, middle, half),
        "line": lambda share: _line(share, middle, half),
        "turn": lambda share: (np.tile(middle, (len(share), 1)), 2 * np.pi * share, 0 * share),
        "still": lambda share: (np.tile(middle, (len(share), 1)), 0 * share, 0 * share),
    }
    share_at = _share_by_time(paths[name], WALK, closed=name != "line")
    times = _time_steps(float(share_at.x[-1]))
    poses = [
        Pose(exp(np.array((0, yaw, 0))) @ exp(np.array((0, 0, roll))), place)
        for place, yaw, roll in zip(*paths[name](share_at(times)), strict=True)
    ]
    return _repeated(Trajectory(times, tuple(poses)), 0.0 if name == "line" else duration)


def _time_steps(end: float) -> Array:
    return np.linspace(0, end, max(int(np.ceil(end / TIME_STEP_S)), 1) + 1)


def _repeated(once: Trajectory, duration: float) -> Trajectory:
    """Repeat a closed motion until it lasts at least a duration."""
    end = once.times[-1]
    rounds = max(int(np.ceil(duration / end)), 1)
    times = [once.times[1:] + k * end for k in range(rounds)]
    return Trajectory(np.concatenate([once.times[:1], *times]), (once.poses[0], *once.poses[1:] * rounds))


def _route_trajectory(route: Route) -> Trajectory:
    """Return the motion along a route: its positions at regular times are control points of a cubic B-spline."""
    rounded = _closed_spline(_resampled(np.array(route.points, float), route.rounding))

    def path(share: Array) -> tuple[Array, Array, Array]:
        ahead = rounded(share, 1)
        return rounded(share), np.unwrap(np.arctan2(ahead[:, 0], ahead[:, 2])), 0 * share

    share_at = _share_by_time(path, route.pace, closed=True)
    end = float(share_at.x[-1])
    controls = int(np.ceil(end / CONTROL_STEP_S))
    spline = _closed_spline(rounded(share_at(end * np.arange(controls) / controls)))
    times = _time_steps(end)
    poses = [
        Pose(_facing(ahead), place) for place, ahead in zip(spline(times / end), spline(times / end, 1), strict=True)
    ]
    return Trajectory(times, tuple(poses))


def _resampled(points: Array, spacing: float) -> Array:
    """Return points at equal distances, about `spacing`, along a closed polyline (N, 3)."""
    closed = np.concatenate([points, points[:1]])
    way = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    count = max(int(np.rint(way[-1] / spacing)), 4)
    at = way[-1] * np.arange(count) / count
    return np.stack([np.interp(at, way, closed[:, k]) for k in range(3)], -1)


def _closed_spline(controls: Array) -> BSpline:
    """Return the closed uniform cubic B-spline of control points (N, 3) as a function of the share of its period."""
    count = len(controls)
    wrapped = np.concatenate([controls[-1:], controls, controls[:2]])
    return BSpline(np.arange(-3, count + 4) / count, wrapped, 3)


def _facing(ahead: Array) -> Array:
    """Return the rotation (3, 3) of a camera without roll that looks along a direction."""
    yaw, pitch = np.arctan2(ahead[0], ahead[2]), np.arctan2(-ahead[1], np.hypot(ahead[0], ahead[2]))
    return exp(np.array((0, yaw, 0))) @ exp(np.array((pitch, 0, 0)))


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


def _share_by_time(path: Path, pace: Pace, *, closed: bool) -> CubicHermiteSpline:
    """Return the share of a path that is covered as a function of time, seconds."""
    share = np.linspace(0, 1, PATH_SAMPLES)
    places, heading, _ = path(share)
    length, turn = np.linalg.norm(np.diff(places, axis=0), axis=1), np.abs(np.diff(heading))
    if length.sum() == 0:  # on the spot
        seconds = max(float(turn.sum()) / pace.turn_rate, 1.0)
        return CubicHermiteSpline(seconds * share, share, np.full(PATH_SAMPLES, 1 / seconds))
    bend = turn / length
    with np.errstate(divide="ignore"):
        limits = [pace.turn_rate / bend, np.sqrt(pace.acceleration / bend)]
    highest = np.minimum(np.minimum(*limits), pace.speed)
    speed = _accelerated(highest, length, pace.acceleration, closed=closed)
    times = np.concatenate([[0], np.cumsum(2 * length / (speed[:-1] + speed[1:]))])
    walked = np.concatenate([[0], np.cumsum(length)])
    return CubicHermiteSpline(times, share, speed / np.gradient(walked, share))


def _accelerated(highest: Array, length: Array, acceleration: float, *, closed: bool) -> Array:
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
                speed[far] = min(speed[far], np.sqrt(speed[near] ** 2 + 2 * acceleration * length[i]))
        if closed:
            speed[0] = speed[-1] = min(speed[0], speed[-1])
    return speed
