"""Trajectories: poses over time, their interpolation and files."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import exp, log
from omnisight.images import write_bytes

Array = NDArray[np.float64]

COLUMNS = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
# Limits for hostile files: bytes, rows, metres and characters.
MAX_FILE_BYTES, MAX_POSES = 64 << 20, 500_000
MAX_COORDINATE_M = 1e9
MAX_NUMBER_CHARS = 40


class Motion(ABC):
    """A pose as a function of time."""

    @abstractmethod
    def at(self, time: float) -> Pose:
        """Return world_from_cam at a time, seconds."""

    def row_poses(self, time: float, height: int, readout: float) -> Sequence[Pose]:
        """Return the pose of each image row under a rolling shutter; the middle row is read at `time`.

        Parameters
        ----------
        time
            Seconds.
        height
            Number of rows.
        readout
            Seconds from the first to the last row.
        """
        offsets = (np.arange(height) - height // 2) / max(height - 1, 1) * readout
        return [self.at(time + offset) for offset in offsets]


@dataclass(frozen=True, eq=False)
class Trajectory(Motion):
    """Poses of a camera over time.

    Attributes
    ----------
    times
        (N,) seconds, increasing.
    poses
        world_from_cam at each.
    """

    times: Array
    poses: tuple[Pose, ...]

    def __post_init__(self) -> None:
        """Check that times and poses match and that times increase."""
        if len(self.times) != len(self.poses) or not len(self.poses):
            raise ValueError(f"a trajectory needs a time for each pose, got {len(self.times)} and {len(self.poses)}")
        if (np.diff(self.times) <= 0).any():
            raise ValueError("the times of a trajectory must increase")

    def at(self, time: float) -> Pose:
        """Interpolate world_from_cam at a time: rotation by spherical interpolation, translation linearly.

        Before the first and after the last pose, return that pose.
        """
        i = int(np.searchsorted(self.times, time, side="right")) - 1
        if i < 0 or i >= len(self.poses) - 1:
            return self.poses[0 if i < 0 else -1]
        share = (time - self.times[i]) / (self.times[i + 1] - self.times[i])
        a, b = self.poses[i], self.poses[i + 1]
        if np.array_equal(a.rotation, b.rotation) and np.array_equal(a.translation, b.translation):
            return a
        turn = a.rotation @ exp(share * log(a.rotation.T @ b.rotation))
        return Pose(turn, (1 - share) * a.translation + share * b.translation)


def quaternion(rotation: ArrayLike) -> Array:
    """Return the quaternion (qx, qy, qz, qw), qw >= 0, of a rotation (3, 3)."""
    w = log(rotation)
    angle = float(np.linalg.norm(w))
    return np.append(np.sinc(angle / (2 * np.pi)) / 2 * w, np.cos(angle / 2))


def write_trajectory(path: str | Path, trajectory: Trajectory) -> None:
    """Write the TUM format: lines of `timestamp tx ty tz qx qy qz qw`, world_from_cam, seconds and metres.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    lines = [f"# {' '.join(COLUMNS)}"]
    for time, pose in zip(format_timestamps(trajectory.times), trajectory.poses, strict=True):
        values = (*pose.translation, *quaternion(pose.rotation))
        lines.append(f"{time} " + " ".join(f"{value:.9f}" for value in values))
    write_bytes(path, ("\n".join(lines) + "\n").encode())


def format_timestamps(times: Array) -> list[str]:
    """Format times (N,), seconds, to microseconds, or exactly if they would not be unique."""
    texts = [f"{time:.6f}" for time in times]
    return texts if len(set(texts)) == len(texts) else [np.format_float_positional(time, trim="0") for time in times]


def read_trajectory(path: str | Path) -> Trajectory:
    """Read the TUM format, or CSV with the same columns in any order named by a header line.

    Without a header a line must have exactly the TUM columns, because longer lines, such as those of EuRoC, have
    another order.

    Raises
    ------
    ValueError
        If a line is invalid; the message has the line number and what was expected.
    OSError
        If the file cannot be read.
    """
    path = Path(path)
    if path.stat().st_size > MAX_FILE_BYTES:
        raise ValueError(
            f"{path}: a file of {path.stat().st_size >> 20} MB is too large for a trajectory, at most"
            f" {MAX_FILE_BYTES >> 20} MB"
        )
    order: list[int] | None = None
    times: list[float] = []
    poses: list[Pose] = []
    first = True
    for number, line in enumerate(path.read_bytes().decode("utf-8-sig", "replace").splitlines(), 1):
        words = line.strip().lstrip("#").replace(",", " ").replace(";", " ").split()
        named = [word.lower() for word in words]
        if first and set(COLUMNS) <= set(named):
            order, first = [named.index(name) for name in COLUMNS], False
            continue
        if not words or line.lstrip().startswith("#"):
            continue
        first = False
        time, pose = _row(words, order, f"{path}, line {number}")
        if times and time <= times[-1]:
            raise ValueError(
                f"{path}, line {number}: the time {time:.15g} is not after {times[-1]:.15g}: times must increase"
            )
        times.append(time)
        poses.append(pose)
        if len(poses) > MAX_POSES:
            raise ValueError(f"{path}: more than {MAX_POSES} poses")
    if not poses:
        raise ValueError(f"{path}: contains no poses; expected lines of {' '.join(COLUMNS)}")
    return Trajectory(np.array(times), tuple(poses))


def _row(words: list[str], order: list[int] | None, where: str) -> tuple[float, Pose]:
    expected = f"expected {len(COLUMNS)} numbers, {' '.join(COLUMNS)}"
    if len(words) != len(COLUMNS) if order is None else len(words) <= max(order):
        raise ValueError(f"{where}: {len(words)} values; {expected}")
    chosen = [words[i] for i in order] if order else words
    values = np.array([_number(word, where, expected) for word in chosen])
    if not np.isfinite(values).all() or (np.abs(values[1:]) > MAX_COORDINATE_M).any():
        wrong = next(v for i, v in enumerate(values) if not np.isfinite(v) or (i and abs(v) > MAX_COORDINATE_M))
        raise ValueError(f"{where}: {wrong:g} is out of range; {expected}")
    q = values[4:]
    length = float(np.linalg.norm(q))
    if not 0.9 < length < 1.1:
        raise ValueError(f"{where}: the quaternion {q.tolist()} has length {length:.3g}, not 1")
    x, y, z, w = q / length
    axis = np.array((x, y, z))
    sine = float(np.linalg.norm(axis))
    angle = 2 * np.arctan2(sine, w)
    return float(values[0]), Pose(exp(axis / sine * angle if sine > 0 else axis), values[1:4])


def _number(word: str, where: str, expected: str) -> float:
    try:
        return float(word if len(word) <= MAX_NUMBER_CHARS else "")
    except ValueError:
        raise ValueError(f"{where}: {word[:MAX_NUMBER_CHARS]!r} is not a number; {expected}") from None
