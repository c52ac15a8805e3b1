"""Trajectory files that are written while the trajectory is computed."""

from collections.abc import Callable, Iterable
from io import StringIO
from pathlib import Path
from types import TracebackType
from typing import Literal, Self, TextIO

from omnisight.images.write import write_bytes
from omnisight.simulation.trajectory import COLUMNS, quaternion
from omnisight.visual_odometry.frame_result import TrackedPose

Format = Literal["tum", "kitti"]


class TrajectoryWriter:
    """Appends poses to a file: an interrupted run keeps those that it has found.

    The file is created or replaced with the first pose: a run without any keeps an earlier file.

    TUM: lines of `timestamp tx ty tz qx qy qz qw`, world_from_rig, without the frames whose pose is not known. KITTI:
    the matrix world_from_rig (3, 4) of each frame in a row, NaN where the pose is not known.

    Attributes
    ----------
    poses
        Number of poses written.
    """

    def __init__(self, path: Path, create: Callable[[], TextIO], format: Format) -> None:
        """Prepare a file, which a function opens."""
        self._path = path
        self._format: Format = format
        self._next = 0
        self.poses = 0
        self._create = create
        self._file: TextIO | None = None

    @classmethod
    def of_path(cls, path: Path, format: Format | None) -> Self:
        """Prepare the file of a path; without a format, in that of its name."""
        by_name = "kitti" if path.suffix.lower() == ".kitti" else "tum"
        return cls(path, lambda: path.open("w", encoding="utf-8", newline="\n"), format or by_name)

    def write(self, poses: Iterable[TrackedPose]) -> None:
        """Append poses, later than all before."""
        for pose in poses:
            file = self._file = self._file or self._started()
            world_from_rig = pose.rig_from_world.inverse()
            if self._format == "tum":
                values = (*world_from_rig.translation, *quaternion(world_from_rig.rotation))
                file.write(f"{pose.seconds:.6f} " + " ".join(f"{value + 0.0:.9f}" for value in values) + "\n")
            else:
                self.skip_to(pose.frame)
                file.write(" ".join(f"{value:.9e}" for value in world_from_rig.matrix.ravel()) + "\n")
            self._next = pose.frame + 1
            self.poses += 1
        if self._file is not None:
            self._file.flush()

    def skip_to(self, frame: int) -> None:
        """Write that the frames before one have no pose; nothing if there is no pose yet."""
        if self._file is None:
            return
        if self._format == "kitti":
            self._file.write((" ".join(["nan"] * 12) + "\n") * (frame - self._next))
        self._next = max(self._next, frame)

    def replace(self, poses: Iterable[TrackedPose], frames: int) -> None:
        """Replace the file by another trajectory of a number of frames, atomically; a pipe or a device keeps its poses.

        Raises
        ------
        OSError
            If the file cannot be written; it is unchanged then.
        """
        if not self._path.is_file():
            return
        text = StringIO()
        writer = TrajectoryWriter(self._path, lambda: text, self._format)
        writer.write(poses)
        writer.skip_to(frames)
        write_bytes(self._path, text.getvalue().encode())

    def _started(self) -> TextIO:
        """Return the open file, with its header."""
        file = self._create()
        if self._format == "tum":
            file.write(f"# {' '.join(COLUMNS)}\n")
        return file

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._file is not None:
            self._file.close()
