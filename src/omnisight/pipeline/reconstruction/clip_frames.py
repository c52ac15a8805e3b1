"""Frames of a video clip or a ROS bag as image files: the counterpart of `omnisight reconstruct clip.mp4`."""

from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.images import Clip, encode_image, to_gray8, write_bytes
from omnisight.images.ros_bag import ImageBag, is_bag
from omnisight.progress import Progress, no_progress

# Width, px, of the thumbnails whose sharpness is compared.
THUMBNAIL_WIDTH_PX = 640
# Error of times in milliseconds, as in Matroska files.
TIME_ROUNDING_S = 6e-4


def extract_frames(
    clip: str | PathLike[str],
    folder: str | PathLike[str],
    fps: float = 2.0,
    progress: Progress = no_progress,
    *,
    topic: str | None = None,
    apply_exif: bool = False,
    warn: Callable[[str], None] = lambda message: None,
) -> list[Path]:
    """Write the sharpest frame of each interval of a video clip or a ROS bag as a JPEG file.

    Frame 123 of `clip.mp4` becomes `clip-000123.jpg`; the first is 0.

    Parameters
    ----------
    clip
        The video file, or the bag.
    folder
        Folder of the images; it is created.
    fps
        Images per second of the clip.
    progress
        Called with the stage, the frames read and their number.
    topic
        Image topic of a bag; it may be left out if only one has images.
    apply_exif
        Rotate frames as the clip specifies for display.
    warn
        Called with a message if the clip has far fewer frames than it declares.

    Returns
    -------
    The files, in the order of the clip.

    Raises
    ------
    ValueError
        If the clip or the bag cannot be read, or `fps` is not positive.
    OSError
        If a file cannot be written.
    """
    if not fps > 0:
        raise ValueError(f"--fps is {fps:g}; choose a positive number of images per second")
    source, target = Path(clip), Path(folder)
    video = None if is_bag(source, topic) else Clip.open(source, upright=apply_exif)
    total, frames = _of_bag(source, topic, fps) if video is None else _of_clip(video, fps)
    target.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []

    def write(frame: _Frame | None) -> None:
        if frame is not None:
            file = target / f"{source.stem}-{frame.index:06d}.jpg"
            data = encode_image(frame.image, file.name)
            # Equal files are not written again: a batch that continues compares the time of modification.
            if not (file.is_file() and file.read_bytes() == data):
                write_bytes(file, data)
            written.append(file)

    sharpest, most, interval, count = None, 0.0, 0, 0
    for frame in frames:
        count = frame.index + 1
        if frame.interval > interval:
            write(sharpest)
            sharpest, interval = None, frame.interval
        sharpness = _sharpness(to_gray8(frame.image))
        if sharpest is None or sharpness > most:
            sharpest, most = frame, sharpness
        progress("frames of the clip", count, max(total, count))
    write(sharpest)
    if video is not None and (truncation := video.truncation(count)):
        warn(truncation)
    return written


@dataclass(frozen=True, eq=False)
class _Frame:
    """A frame: its index, that of its interval, and the image."""

    index: int
    interval: int
    image: NDArray[Any]


def _of_clip(clip: Clip, fps: float) -> tuple[int, Iterator[_Frame]]:
    """Return the declared number of frames of a clip, and those that can be read."""
    frames = ((f.index, f.seconds, f.image) for f in clip.frames(limit=None))
    return clip.declared_frames or 0, _in_intervals(frames, fps)


def _of_bag(source: Path, topic: str | None, fps: float) -> tuple[int, Iterator[_Frame]]:
    """Return the number of messages of a bag, and the frames that can be read."""
    bag = ImageBag.open(source, topic)
    return bag.declared_frames, _in_intervals(
        ((index, f.seconds, f.image) for index, f in enumerate(bag.frames()) if f.image is not None), fps
    )


def _in_intervals(frames: Iterable[tuple[int, float, NDArray[Any]]], fps: float) -> Generator[_Frame]:
    """Yield frames, given by their index, time (s) and image, with their interval since the first."""
    start = None
    for index, seconds, image in frames:
        start = seconds if start is None else start
        yield _Frame(index, int((seconds - start + TIME_ROUNDING_S) * fps), image)


def _sharpness(gray: NDArray[np.uint8]) -> float:
    """Return the variance of the Laplacian of a thumbnail."""
    import cv2

    scale = min(THUMBNAIL_WIDTH_PX / gray.shape[1], 1.0)
    small = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return float(np.var(cv2.Laplacian(small, cv2.CV_32F)))
