"""Trajectory files that are written while the trajectory is computed."""

import os
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Literal, Self

from omnisight.simulation.trajectory import COLUMNS, quaternion
from omnisight.visual_odometry.frame_result import TrackedPose

Format = Literal["tum", "kitti"]


def trajectory_format(path: Path) -> Format:
    """Return the format of a file by its name."""
    return "kitti" if path.suffix.lower() == ".kitti" else "tum"


class TrajectoryWriter:
    """Appends poses to a file, so that an interrupted run keeps those that it has found.

    TUM: lines of `timestamp tx ty tz qx qy qz qw`, world_from_rig, without the frames whose pose is not known. KITTI:
    the matrix world_from_rig (3, 4) of each frame in a row, NaN where the pose is not known.

    Attributes
    ----------
    poses
        Number of poses written.
    """

    def __init__(self, path: Path, format: Format) -> None:
        """Start the file."""
        self._format = format
        self._next = 0
        self.poses = 0
        self._file = path.open("w", encoding="utf-8", newline="\n")
        if format == "tum":
            self._file.write(f"# {' '.join(COLUMNS)}\n")

    def write(self, poses: Iterable[TrackedPose]) -> None:
        """Append poses, later than all before."""
        for pose in poses:
            world_from_rig = pose.rig_from_world.inverse()
            if self._format == "tum":
                values = (*world_from_rig.translation, *quaternion(world_from_rig.rotation))
                self._file.write(f"{pose.seconds:.6f} " + " ".join(f"{value + 0.0:.9f}" for value in values) + "\n")
            else:
                self.skip_to(pose.frame)
                self._file.write(" ".join(f"{value:.9e}" for value in world_from_rig.matrix.ravel()) + "\n")
            self._next = pose.frame + 1
            self.poses += 1
        self._file.flush()

    def skip_to(self, frame: int) -> None:
        """Note that the frames before one have no pose."""
        if self._format == "kitti":
            self._file.write((" ".join(["nan"] * 12) + "\n") * (frame - self._next))
        self._next = max(self._next, frame)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()


def rewrite_trajectory(path: Path, format: Format, poses: Iterable[TrackedPose], frames: int) -> None:
    """Replace a trajectory by other poses of the same number of frames, at once."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with TrajectoryWriter(temporary, format) as file:
            file.write(poses)
            file.skip_to(frames)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
