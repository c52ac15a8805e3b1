"""Sequential reading of video files, with a one-line reason for each file that cannot be read."""

import dataclasses
from collections.abc import Collection, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.display import Displayed
from omnisight.images.collect import IMAGE_SUFFIXES
from omnisight.images.planes import Yuv, rotated
from omnisight.images.read import UnreadableImage
from omnisight.images.video_files import VIDEO_SUFFIXES, avi_frame_count, find_defect, has_clip_suffix
from omnisight.parallel import thread_count

# A larger frame is refused before memory is allocated for it.
MAX_FRAME_PIXELS = 10**8
# Eleven minutes at 30 frames per second: no calibration needs more.
MAX_FRAMES = 20_000
# Share of the declared frames below which a clip counts as truncated; many declare a few too many.
MIN_COMPLETE_SHARE = 0.95
# Relative difference of frame rates up to which clips have one nominal rate: 29.97 and 30.
MAX_RATE_DIFFERENCE = 0.002
# The frame rate of a file that does not specify one.
DEFAULT_FRAME_RATE = 30.0
# Units of the start and the duration of a container, per second.
CONTAINER_UNITS = 1_000_000

FFMPEG_HINT = "convert it, for example with: ffmpeg -i {} -c:v libx264 -crf 10 clip.mp4"
UNSUPPORTED = "{0}: FFmpeg cannot decode this video; " + FFMPEG_HINT.format("{0}")
# Without it FFmpeg decodes a frame to find the pixel format, which takes 30 ms at 1080p; each decoded frame has it.
WITHOUT_PIXEL_FORMAT = {"skip_frame": "all"}


def is_clip(path: Path) -> bool:
    """Return whether a path is a video clip, by its extension, and not images.

    Raises
    ------
    ValueError
        If it is a file of another kind.
    """
    is_video = has_clip_suffix(path)
    if path.is_file() and not is_video and path.suffix.lower() not in IMAGE_SUFFIXES:
        clips, images = (" ".join(suffix[1:] for suffix in each) for each in (VIDEO_SUFFIXES, IMAGE_SUFFIXES))
        raise ValueError(
            f"{path}: neither a video clip ({clips}) nor an image ({images}) by its extension; if it is a clip,"
            f" {FFMPEG_HINT.format(path)}"
        )
    return is_video


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame of a video.

    Attributes
    ----------
    index : int
        Index in the file, from 0.
    seconds : float
        Time stamp from the start of the file.
    decoded
        The frame of PyAV.
    rotation_deg : int
        Clockwise rotation, a multiple of 90, that makes it upright; 0 to keep it as it is stored.
    """

    index: int
    seconds: float
    decoded: Any
    rotation_deg: int = 0

    @cached_property
    def image(self) -> NDArray[np.uint8]:
        """RGB image (H, W, 3)."""
        rgb = self.decoded.to_ndarray(format="rgb24")
        return np.ascontiguousarray(np.rot90(rgb, -self.rotation_deg // 90)) if self.rotation_deg else rgb

    @property
    def gray(self) -> NDArray[np.uint8]:
        """Gray image (H, W), the same as `to_gray8(image)`."""
        import cv2

        return np.asarray(cv2.cvtColor(self.image, cv2.COLOR_RGB2GRAY), np.uint8)

    def yuv(self, depth: int = 8) -> Yuv:
        """Return luma and chroma (4:2:0) of 8 or 10 bits, without a copy where they are stored so."""
        return rotated(Yuv.of(self.decoded, depth), self.rotation_deg)


@dataclass(frozen=True)
class Clip(Displayed):
    """A video file.

    Attributes
    ----------
    path : Path
    size : (int, int)
        Width and height of the frames, px.
    frame_rate : float
        Frames per second; 30 if not specified.
    declared_frames : int or None
        Number of frames according to the header, which may be wrong; None if not specified.
    upright : bool
        Whether frames are rotated by `rotation_deg`. Off by default, because a calibration refers to the sensor.
    seconds : float or None
        Duration according to the header; None if not specified.
    time_base : Fraction
        Unit of the time stamps, seconds.
    """

    path: Path
    size: tuple[int, int]
    frame_rate: float
    declared_frames: int | None
    upright: bool
    seconds: float | None = None
    time_base: Fraction = Fraction(1, 90_000)

    @classmethod
    def open(cls, path: str | Path, *, upright: bool = False) -> "Clip":
        """Read the header of a video file.

        Raises
        ------
        UnreadableImage
            If the file is missing, empty, truncated before its index, not a video, or has an unsupported codec.
        """
        path = Path(path)
        with video_input(path) as (container, stream):
            width, height = stream.codec_context.width, stream.codec_context.height
            if width * height > MAX_FRAME_PIXELS:
                raise UnreadableImage(
                    f"{path.name}: frames of {width} x {height} pixels, more than the supported {MAX_FRAME_PIXELS:.0e}"
                )
            rate = float(stream.average_rate or stream.guessed_rate or 0)
            rate = rate if 1 <= rate <= 10_000 else DEFAULT_FRAME_RATE
            seconds = container.duration / CONTAINER_UNITS if container.duration else None
            count = max(avi_frame_count(path), stream.frames, 0) or round((seconds or 0) * rate)
            time_base = Fraction(stream.time_base or 1 / Fraction(rate).limit_denominator(1001))
        clip = cls(path, (width, height), rate, count or None, upright, seconds, time_base)
        return dataclasses.replace(clip, size=(height, width)) if upright and clip.rotation_deg % 180 else clip

    @property
    def rotation_deg(self) -> int:
        """Rotation that the file specifies for display: a multiple of 90."""
        return self._display[0]

    @property
    def bits(self) -> int:
        """Bits of a channel."""
        return self._display[1]

    @cached_property
    def _display(self) -> tuple[int, int]:
        """Rotation and bits, which only decoded frames have: 70 ms at 1080p, unless `frames` decodes them anyway."""
        with video_input(self.path) as (container, stream):
            return _display_of(next(_decoded(container, stream), None))

    def truncation(self, count: int) -> str:
        """Return that the clip ends early if it has `count` frames, far fewer than it declares; empty otherwise."""
        declared = self.declared_frames or 0
        if count >= MIN_COMPLETE_SHARE * declared:
            return ""
        return f"{self.path.name}: ends after {count} of {declared} frames: is the copy truncated?"

    def frames(self, indices: Collection[int] | None = None, *, limit: int | None = MAX_FRAMES) -> Generator[Frame]:
        """Decode frames one at a time, in order: the first `limit`, or those with the given indices.

        Raises
        ------
        UnreadableImage
            If no frame can be decoded, or if the frame size changes.
        """
        last = limit if indices is None else max(indices, default=-1) + 1
        stored = self.size[::-1] if self.upright and self.rotation_deg % 180 else self.size
        index = 0
        if last == 0:
            return
        with video_input(self.path) as (container, stream):
            start = (container.start_time or 0) / CONTAINER_UNITS
            for decoded in _decoded(container, stream):
                if index == 0:
                    vars(self)["_display"] = _display_of(decoded)
                if indices is None or index in indices:
                    if (decoded.width, decoded.height) != stored:
                        raise UnreadableImage(
                            f"{self.path.name}: frame {index} has {decoded.width}x{decoded.height} pixels, not"
                            f" {stored[0]}x{stored[1]}; split the video into parts of equal frames"
                        )
                    time = index / self.frame_rate if decoded.time is None else decoded.time - start
                    yield Frame(index, time, decoded, self.rotation_deg if self.upright else 0)
                index += 1
                if index == last:
                    break
        if index == 0:
            raise UnreadableImage(f"{self.path.name}: no frame can be decoded; {FFMPEG_HINT.format(self.path.name)}")


def _display_of(first: Any) -> tuple[int, int]:
    """Return rotation and bits of the first frame of a clip; None if no frame can be decoded."""
    if first is None:
        return 0, 8
    return -int(first.rotation) % 360, max((component.bits for component in first.format.components), default=8)


def check_frame_rates(clips: Sequence[Clip]) -> None:
    """Check that frames of the same number in several clips can be simultaneous.

    Raises
    ------
    ValueError
        If the frame rates differ.
    """
    if not clips:
        return
    slow, fast = (select(clips, key=lambda clip: clip.frame_rate) for select in (min, max))
    if fast.frame_rate > (1 + MAX_RATE_DIFFERENCE) * slow.frame_rate:
        raise ValueError(
            f"{fast.path} has {fast.frame_rate:.4g} frames per second and {slow.path} {slow.frame_rate:.4g}: frames of"
            f" the same number are not simultaneous; convert one (ffmpeg -i {fast.path.name} -r {slow.frame_rate:.4g})"
        )


@contextmanager
def video_input(path: Path) -> Generator[tuple[Any, Any]]:
    """Open a video file and return its container and its first video stream.

    Raises
    ------
    UnreadableImage
        If the file is missing or cannot be decoded.
    """
    with open_container(path, **WITHOUT_PIXEL_FORMAT) as container:
        streams: Any = container.streams.video
        stream = next((s for s in streams if s.codec_context is not None), None)  # None: of an unknown codec
        if stream is None:
            raise UnreadableImage(UNSUPPORTED.format(path.name))
        stream.thread_type = "AUTO"
        stream.codec_context.thread_count = thread_count()
        yield container, stream


def open_container(path: Path, **options: str) -> Any:
    """Open a video file with options of FFmpeg.

    Raises
    ------
    UnreadableImage
        If the file is missing or is not a video.
    """
    import av  # imported on use: it loads the libraries of FFmpeg
    from av.error import FFmpegError

    defect = find_defect(path)
    if defect is not None:
        raise UnreadableImage(f"{path.name}: {defect}")
    try:
        # Only files: a name with a colon would be a URL.
        return av.open(str(path.resolve()), options={"protocol_whitelist": "file", **options})
    except (FFmpegError, OSError, ValueError):
        raise UnreadableImage(UNSUPPORTED.format(path.name)) from None


def _decoded(container: Any, stream: Any) -> Generator[Any]:
    """Decode the frames of a stream; damaged packets are skipped."""
    from av.error import FFmpegError

    try:
        for packet in container.demux(stream):
            try:
                yield from packet.decode()
            except FFmpegError:
                continue
    except (FFmpegError, OSError):  # the rest of the file is damaged
        return
