"""Motion of a view over time: keyframes, a pan, and stabilization by the poses of the camera."""

import csv
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.rotation import nearest
from omnisight.pipeline.views.view_options import ViewMotion, ViewOptions

if TYPE_CHECKING:
    from omnisight.simulation.trajectory import Trajectory

Array = NDArray[np.float64]

# Columns of a file of keyframes besides `time`.
CHANNELS = ("yaw", "pitch", "roll", "fov")
# Samples of the orientation in one standard deviation of its smoothing, and standard deviations that are averaged.
SAMPLES_PER_SIGMA, SIGMAS = 4, 3


Angles = Callable[[float], dict[str, float]]


def view_angles(motion: ViewMotion, seconds: float | None) -> Angles:
    """Return a function from the time to the angles that move.

    Parameters
    ----------
    motion
        The motion.
    seconds
        Duration of the clip, to its last frame.

    Raises
    ------
    ValueError
        If the file of keyframes is invalid, or the duration of a pan is not known.
    """
    if motion.pan is not None:
        if not seconds or seconds <= 0:
            raise ValueError("the duration of the clip is not known: use --path with two keyframes instead of --pan")
        low, high = motion.pan
        return lambda time: {"yaw": low + (high - low) * min(max(time / seconds, 0.0), 1.0)}
    if motion.path is None:
        return lambda time: {}
    times, values = read_keyframes(motion.path)
    if len(times) == 1:
        return lambda time: {name: float(column[0]) for name, column in values.items()}
    from scipy.interpolate import PchipInterpolator  # imported on use: scipy is slow to import

    curves = {name: PchipInterpolator(times, column) for name, column in values.items()}
    return lambda time: {name: float(f(min(max(time, times[0]), times[-1]))) for name, f in curves.items()}


def read_keyframes(path: Path) -> tuple[Array, dict[str, Array]]:
    """Read the times and the columns of a file of keyframes.

    Raises
    ------
    ValueError
        If a column is unknown or a line invalid; the message has the line number.
    """
    rows = [
        (number, [word.strip() for word in row])
        for number, row in enumerate(csv.reader(path.read_text(encoding="utf-8-sig").splitlines()), 1)
        if row and not row[0].startswith("#")
    ]
    names = [name.lower() for name in rows[0][1]] if rows else []
    unknown = [name for name in names if name not in ("time", *CHANNELS)]
    if "time" not in names or len(names) < 2 or unknown or len(set(names)) < len(names):
        raise ValueError(
            f"{path}, line 1: expected a header such as time,yaw,pitch,roll,fov, got {','.join(names)[:80]!r}"
        )
    table: list[list[float]] = []
    for number, words in rows[1:]:
        try:
            values = [float(word) for word in words]
        except ValueError:
            values = []
        if len(values) != len(names) or not np.isfinite(values).all():
            raise ValueError(f"{path}, line {number}: expected {len(names)} numbers, got {','.join(words)[:80]!r}")
        table.append(values)
    if not table:
        raise ValueError(f"{path}: contains no keyframe")
    columns = dict(zip(names, np.array(table).T, strict=True))
    times = columns.pop("time")
    if (np.diff(times) <= 0).any():
        number = rows[1 + int(np.argmax(np.diff(times) <= 0)) + 1][0]
        raise ValueError(f"{path}, line {number}: the times of keyframes must increase")
    return times, columns


def check_fixed_angles(options: ViewOptions, motion: ViewMotion, angles: dict[str, float]) -> None:
    """Raise `ValueError` if an angle is specified that the motion replaces."""
    for name in angles:
        value = getattr(options, name)
        if value is not None and (value != 0.0 or name not in ("yaw", "roll")):
            moving = "--pan" if motion.pan is not None else f"--path {motion.path}"
            raise ValueError(f"--{name} {value:g}: {moving} contains the {name}; leave out one of them")


def moved(options: ViewOptions, angles: dict[str, float]) -> ViewOptions:
    """Return the options of a view with other angles."""
    return replace(options, **angles)


def stabilization(motion: ViewMotion, seconds: float | None) -> Callable[[float], Array]:
    """Return a function from the time to the rotation (3, 3) from the camera to the stable frame.

    Raises
    ------
    ValueError
        If the file is invalid or covers none of the clip.
    """
    if motion.stabilize is None:
        return lambda time: np.eye(3)
    from omnisight.simulation.trajectory import read_trajectory  # takes 0.2 s to import

    trajectory = read_trajectory(motion.stabilize)
    first, last = float(trajectory.times[0]), float(trajectory.times[-1])
    if first > (seconds or math.inf) or last < 0:
        raise ValueError(
            f"{motion.stabilize}: has poses from {first:g} to {last:g} s, and the clip is from 0 to {seconds or 0:g} s:"
            " times are from the start of the clip"
        )
    if motion.follow is None:
        stable_from_world = trajectory.poses[0].rotation.T
        return lambda time: stable_from_world @ trajectory.at(time).rotation
    sigma = motion.follow
    return lambda time: _smoothed(trajectory, time, sigma).T @ trajectory.at(time).rotation


def _smoothed(trajectory: "Trajectory", time: float, sigma: float) -> Array:
    """Return the mean of the orientations world_from_cam around a time, weighted by a Gaussian."""
    offsets = np.arange(-SIGMAS * SAMPLES_PER_SIGMA, SIGMAS * SAMPLES_PER_SIGMA + 1) / SAMPLES_PER_SIGMA
    rotations = np.stack([trajectory.at(time + sigma * offset).rotation for offset in offsets])
    return nearest(np.einsum("n,nij->ij", np.exp(-(offsets**2) / 2), rotations))
