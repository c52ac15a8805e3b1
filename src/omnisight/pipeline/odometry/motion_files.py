"""Tables of motion sensors: the IMU in the format of EuRoC, and the speed of wheels."""

import csv
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.visual_odometry.imu import ImuSamples
from omnisight.visual_odometry.wheel_scale import WheelSpeeds

Array = NDArray[np.float64]

# Step of times above which they are in nanoseconds, as in EuRoC and ROS: no sensor is slower than a quarter of an hour.
MAX_STEP_S = 1000.0
MIN_SAMPLES = 2


def read_imu(path: Path) -> ImuSamples:
    """Read lines of time, angular velocity x y z (rad/s), and specific force x y z (m/s^2).

    Raises
    ------
    ValueError
        If a line has other values, or times do not increase.
    """
    rows = _read(path, 7, "time, w_x, w_y, w_z (rad/s), a_x, a_y, a_z (m/s^2)")
    return ImuSamples(rows[:, 0], rows[:, 1:4], rows[:, 4:7])


def read_wheels(path: Path) -> WheelSpeeds:
    """Read lines of time and speed (m/s), which a yaw rate may follow; see `read_imu` for errors.

    Longer lines are refused: the second column of tables of other sensors is no speed, such as the latitude of GNSS.
    """
    rows = _read(path, 2, "time, speed (m/s)", most=3)
    return WheelSpeeds(rows[:, 0], rows[:, 1])


def _read(path: Path, columns: int, expected: str, most: float = math.inf) -> Array:
    """Read the first columns of a table (N, columns), with times in seconds; a first line of titles is skipped."""
    rows = list[list[float]]()
    for number, row in enumerate(csv.reader(path.read_text(encoding="utf-8-sig").splitlines()), 1):
        if not row or row[0].lstrip().startswith("#"):
            continue
        try:
            values = [float(value) for value in row[:columns]]
        except ValueError:
            if number == 1:
                continue
            values = list[float]()
        if len(values) < columns or len(row) > most or not np.isfinite(values).all():
            raise ValueError(f"{path}, line {number}: expected {expected}, got {','.join(row)!r}")
        rows.append(values)
    if len(rows) < MIN_SAMPLES:
        raise ValueError(f"{path}: has {len(rows)} samples: expected lines of {expected}")
    table = np.array(rows)
    if np.median(np.diff(table[:, 0])) > MAX_STEP_S:
        table[:, 0] *= 1e-9
    steps = np.diff(table[:, 0])
    if not (steps > 0).all():
        k = int(np.argmin(steps > 0))
        raise ValueError(f"{path}: the time of sample {k + 2}, {table[k + 1, 0]:.6f} s, is not after the one before")
    return table
