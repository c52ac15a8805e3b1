"""The frames of a folder, a clip, a bag, or a rig in the order of time."""

import csv
import math
import os
from collections.abc import Collection, Generator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.images import UnreadableImage, has_clip_suffix, read_image, readable_images
from omnisight.images.live_camera import LiveCamera
from omnisight.images.ros_bag import ImageBag, is_bag
from omnisight.images.video import Clip, is_clip
from omnisight.pipeline.inputs.image_set import image_set
from omnisight.pipeline.odometry.sequence_options import SequenceOptions

# Images per second of a folder without times.
DEFAULT_FPS = 10.0
TIMES_FILE = "times.csv"
# Lists of images with their times, as those of the TUM RGB-D data sets and of omnisight simulate.
LIST_FILES = "images.txt", "rgb.txt"


@dataclass(frozen=True, eq=False)
class SequenceFrame:
    """A frame of a sequence.

    Attributes
    ----------
    index, seconds
        Index in the sequence, and time.
    images
        One image (H, W) or (H, W, 3) of each camera; none if one is missing.
    reason
        Why there are no images; empty otherwise.
    dropped
        Of a connected camera the number of frames so far that arrived while an earlier one was processed.
    """

    index: int
    seconds: float
    images: tuple[NDArray[Any], ...]
    reason: str = ""
    dropped: int = 0


@dataclass(frozen=True, eq=False)
class FrameSequence:
    """The frames of a camera or of a rig.

    Attributes
    ----------
    files
        For each frame the files of all cameras, None where one is missing; none for a clip or a bag.
    times
        Their times, seconds.
    clip
        The clip.
    label
        Name in messages.
    times_file
        File of the times; None without.
    stream
        The image topic of a bag.
    camera
        The connected camera.
    apply_exif
        Whether images are rotated by their EXIF orientation.
    """

    files: tuple[tuple[Path | None, ...], ...]
    times: tuple[float, ...]
    label: str
    clip: Clip | None = None
    times_file: Path | None = None
    stream: ImageBag | None = None
    camera: LiveCamera | None = None
    apply_exif: bool = False

    @classmethod
    def live(cls, source: str, options: SequenceOptions) -> "FrameSequence":
        """Open the camera with this number, or the clip that is played in place of one.

        Raises
        ------
        ValueError
            If there is no such camera or clip.
        """
        if not source.isdigit() and not has_clip_suffix(source):
            raise ValueError(f"{source}: is neither the number of a connected camera, such as 0, nor a clip")
        camera = LiveCamera(int(source) if source.isdigit() else Path(source), upright=options.apply_exif)
        return cls((), (), camera.label, camera=camera)

    def close(self) -> None:
        """Release the camera."""
        if self.camera is not None:
            self.camera.close()

    @classmethod
    def open(cls, source: Path, cameras: tuple[str, ...], options: SequenceOptions) -> "FrameSequence":
        """List the frames of a folder, a clip or a bag.

        Parameters
        ----------
        source
            Folder of images, a video clip, or a ROS bag.
        cameras
            Names of the cameras of a rig, whose images are in folders or files of these names; none for one camera.
        options
            How the sequence is read.

        Raises
        ------
        ValueError
            If there are no images, or times are missing or do not increase.
        """
        fps = options.fps
        if is_bag(source, options.topic):
            if cameras:
                raise ValueError(f"{source}: a topic has the images of one camera, and the rig has {len(cameras)}")
            if fps is not None:
                raise ValueError(f"{source}: a bag has its own times: leave out --fps")
            return cls((), (), str(source), stream=ImageBag.open(source, options.topic))
        if is_clip(source):
            if cameras:
                raise ValueError(f"{source}: a clip has the images of one camera, and the rig has {len(cameras)}")
            if fps is not None:
                raise ValueError(f"{source}: a clip has its own times: leave out --fps")
            return cls((), (), str(source), Clip.open(source, upright=options.apply_exif))
        of_camera = source / (options.name or "")
        source = of_camera if of_camera.is_dir() else source
        found = image_set(source, cameras, is_rig=bool(cameras))
        count = int(found.frame.max()) + 1
        files: list[list[Path | None]] = [[None] * max(len(cameras), 1) for _ in range(count)]
        for path, camera, frame in zip(found.paths, found.camera, found.frame, strict=True):
            files[frame][camera] = path
        frames = tuple(map(tuple, files))
        times, table = _times(source, frames, fps)
        return cls(frames, times, str(source), times_file=table, apply_exif=options.apply_exif)

    def __len__(self) -> int:
        """Return the number of frames; for a clip the number that its header declares, or 0; 0 for a camera."""
        if self.stream is not None:
            return self.stream.declared_frames
        return (self.clip.declared_frames or 0) if self.clip is not None else len(self.files)

    @property
    def paths(self) -> list[Path]:
        """The files of a folder, with that of the times."""
        return [path for frame in (*self.files, (self.times_file,)) for path in frame if path is not None]

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the first image of the first camera that can be read, px."""
        if self.camera is not None:
            return self.camera.size
        if self.stream is not None:
            return self.stream.size
        if self.clip is not None:
            return self.clip.size
        files = (frame[0] for frame in self.files if frame[0] is not None)
        _, image = next(readable_images(files, apply_exif=self.apply_exif))
        return image.shape[1], image.shape[0]

    def warnings(self, count: int) -> tuple[str, ...]:
        """Return the warning that a clip of `count` frames ends early, or none."""
        truncation = "" if self.clip is None else self.clip.truncation(count)
        return (truncation,) if truncation else ()

    def __iter__(self) -> Iterator[SequenceFrame]:
        """Read all frames; see `frames`."""
        return self.frames()

    def frames(self, indices: Collection[int] | None = None) -> Iterator[SequenceFrame]:
        """Read all frames, or those with indices, one at a time; one that cannot be read has a reason, not images."""
        if self.camera is not None:
            return self._of_camera(self.camera)
        if self.stream is not None:
            return self._of_stream(self.stream, indices)
        return self._of_clip(self.clip, indices) if self.clip is not None else self._of_files(indices)

    def _of_camera(self, camera: LiveCamera) -> Generator[SequenceFrame]:
        for frame in camera.frames():
            yield SequenceFrame(frame.index, frame.seconds, (frame.image,), dropped=camera.dropped)

    def _of_clip(self, clip: Clip, indices: Collection[int] | None) -> Generator[SequenceFrame]:
        last = -math.inf
        for frame in clip.frames(indices, limit=None):
            # Some files have no times, or the same for several frames.
            seconds = frame.seconds if frame.seconds > last else frame.index / clip.frame_rate
            last = max(seconds, last + 1e-6)
            yield SequenceFrame(frame.index, last, (frame.gray,))

    def _of_stream(self, stream: ImageBag, indices: Collection[int] | None) -> Generator[SequenceFrame]:
        for index, frame in enumerate(stream.frames()):
            if indices is None or index in indices:
                images = () if frame.image is None else (frame.image,)
                yield SequenceFrame(index, frame.seconds, images, frame.reason)

    def _of_files(self, indices: Collection[int] | None) -> Generator[SequenceFrame]:
        sizes = dict[int, tuple[int, ...]]()
        for index in range(len(self.files)) if indices is None else sorted(indices):
            seconds, files = self.times[index], self.files[index]
            try:
                images = tuple(read_image(path, apply_exif=self.apply_exif) for path in files if path is not None)
            except UnreadableImage as error:
                yield SequenceFrame(index, seconds, (), str(error))
                continue
            reason = "" if len(images) == len(files) else "no image of one of the cameras"
            for camera, (path, image) in enumerate(zip(files, images, strict=False)):
                shape = image.shape[:2]
                if not reason and path is not None and sizes.setdefault(camera, shape) != shape:
                    width, height = sizes[camera][::-1]
                    reason = f"{path.name}: is {shape[1]}x{shape[0]} px, and images before {width}x{height}"
            yield SequenceFrame(index, seconds, () if reason else images, reason)


def _times(
    source: Path, frames: tuple[tuple[Path | None, ...], ...], fps: float | None
) -> tuple[tuple[float, ...], Path | None]:
    """Return the times of frames, of a file or at a constant rate, and the file."""
    images = [path for path in frames[0] if path is not None]
    folders = dict.fromkeys([source, source.parent, *(up for path in images for up in list(path.parents)[:2])])
    tables = [folder / TIMES_FILE for folder in folders if (folder / TIMES_FILE).is_file()]
    lists = [folder / name for folder in folders for name in LIST_FILES if (folder / name).is_file()]
    table = next(iter([*tables, *(path for path in lists if _lists_any(path, images))]), None)
    if table is None or fps is not None:
        return tuple(frame / (fps or DEFAULT_FPS) for frame in range(len(frames))), None
    known = _read_times(table)
    times = [_time_of(files, source, known, table) for files in frames]
    steps = np.diff(times)
    if len(steps) and not (steps > 0).all():
        k = int(np.argmin(steps > 0))
        name = next(path.name for path in frames[k + 1] if path is not None)
        raise ValueError(
            f"{table}: the time of {name}, {times[k + 1]:.15g} s, is not after {times[k]:.15g} s of the one before"
        )
    return tuple(times), table


def _lists_any(path: Path, images: list[Path]) -> bool:
    """Return whether a list has one of these images: COLMAP's images.txt, and a text of another encoding, have none."""
    try:
        with path.open(encoding="utf-8-sig") as file:
            first = next((line.split() for line in file if line.strip() and not line.startswith("#")), [])
        # COLMAP's file, of more columns, can have a gigabyte.
        names = {row[0] for row in _rows(path) if row} if len(first) == len(("seconds", "name")) else set[str]()
    except UnicodeDecodeError:
        return False
    return any(image.name in names for image in images)


def _rows(table: Path) -> list[list[str]]:
    """Return the lines of a table as [name, seconds], and of a list as [name without folders, seconds]."""
    lines = table.read_text(encoding="utf-8-sig").splitlines()
    if table.name == TIMES_FILE:
        return list(csv.reader(lines))
    rows = [line.split() for line in lines]
    return [[row[1].rpartition("/")[2], row[0]] if len(row) == len(("seconds", "name")) else row for row in rows]


def _read_times(table: Path) -> dict[str, float]:
    """Read lines of name,seconds, or of seconds and name of a list; a first line of titles is skipped."""
    known = dict[str, float]()
    for number, row in enumerate(_rows(table), 1):
        if not row or any(value.startswith("#") for value in row):
            continue
        try:
            seconds = float(row[1])
        except (IndexError, ValueError):
            if number == 1:
                continue
            raise ValueError(f"{table}, line {number}: expected {_line(table)}, got {','.join(row)!r}") from None
        if not math.isfinite(seconds):
            raise ValueError(f"{table}, line {number}: {row[1]} is not a time")
        known[row[0].strip()] = seconds
    return known


def _line(table: Path, name: str = "name") -> str:
    """Return the form of a line of a table."""
    return f"{name},seconds" if table.name == TIMES_FILE else f"seconds {name}"


def _time_of(files: tuple[Path | None, ...], source: Path, known: dict[str, float], table: Path) -> float:
    """Return the time of a frame, by the name of one of its files."""
    paths = [path for path in files if path is not None]
    for path in paths:
        relative = Path(os.path.abspath(path)).relative_to(os.path.abspath(source)).as_posix()
        for name in (relative, path.name, path.stem):
            if name in known:
                return known[name]
    raise ValueError(f"{table}: has no time of {paths[0].name}: add the line {_line(table, paths[0].name)}")
