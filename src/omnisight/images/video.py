"""Sequential reading of video files, with a one-line reason for each file that cannot be read."""

import os
import threading
from collections.abc import Collection, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.images.read import UnreadableImage

VIDEO_SUFFIXES = (
    *(".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".mpg", ".mpeg", ".mts", ".m2ts", ".wmv"),
    # The containers of Insta360 and GoPro MAX cameras.
    *(".insv", ".360"),
)
# A larger frame is refused before memory is allocated for it.
MAX_FRAME_PIXELS = 10**8
# Eleven minutes at 30 frames per second: no calibration needs more.
MAX_FRAMES = 20_000
# A limit on the top-level boxes of an MP4 file, so that a hostile file cannot stall the reader.
MAX_MP4_BOXES = 1000
# The frame rate of a file that does not specify one.
DEFAULT_FRAME_RATE = 30.0

FFMPEG_HINT = "convert it, for example with: ffmpeg -i {} -c:v libx264 -crf 10 clip.mp4"

_open_lock = threading.Lock()


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame of a video.

    Attributes
    ----------
    index : int
        Index in the file, from 0.
    seconds : float
        Time stamp in the file.
    bgr : (H, W, 3) array of uint8
        Blue, green, red, as decoded.
    """

    index: int
    seconds: float
    bgr: NDArray[np.uint8]

    @property
    def image(self) -> NDArray[np.uint8]:
        """RGB image (H, W, 3)."""
        return self.bgr[..., ::-1]

    @property
    def gray(self) -> NDArray[np.uint8]:
        """Gray image (H, W), the same as `to_gray8(image)`."""
        import cv2

        return np.asarray(cv2.cvtColor(self.bgr, cv2.COLOR_BGR2GRAY), np.uint8)


@dataclass(frozen=True)
class Clip:
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
    rotation_deg : int
        Rotation that the file specifies for display: a multiple of 90.
    upright : bool
        Whether frames are rotated accordingly. Off by default, because a calibration refers to the sensor.
    """

    path: Path
    size: tuple[int, int]
    frame_rate: float
    declared_frames: int | None
    rotation_deg: int
    upright: bool

    @classmethod
    def open(cls, path: str | Path, *, upright: bool = False) -> "Clip":
        """Read the header of a video file.

        Raises
        ------
        UnreadableImage
            If the file is missing, empty, truncated before its index, not a video, or has an unsupported codec.
        """
        import cv2

        path = Path(path)
        defect = _find_defect(path)
        if defect is not None:
            raise UnreadableImage(f"{path.name}: {defect}")
        with path.open("rb") as file:
            avi_frames = _avi_frame_count(file.read(52))
        with _capture(path, upright) as capture:
            width, height = (int(capture.get(p)) for p in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
            rate, count = capture.get(cv2.CAP_PROP_FPS), capture.get(cv2.CAP_PROP_FRAME_COUNT)
            rotation = int(capture.get(cv2.CAP_PROP_ORIENTATION_META)) % 360
        if width * height > MAX_FRAME_PIXELS:
            raise UnreadableImage(
                f"{path.name}: frames of {width} x {height} pixels, more than the supported {MAX_FRAME_PIXELS:.0e}"
            )
        return cls(
            path,
            (width, height),
            rate if 1 <= rate <= 10_000 else DEFAULT_FRAME_RATE,
            max(avi_frames, int(count) if count < 1e9 else 0, 0) or None,
            rotation,
            upright,
        )

    def frames(self, indices: Collection[int] | None = None) -> Generator[Frame]:
        """Decode frames one at a time, in order: the first `MAX_FRAMES`, or those with the given indices.

        Raises
        ------
        UnreadableImage
            If no frame can be decoded, or if the frame size changes.
        """
        import cv2

        last = MAX_FRAMES - 1 if indices is None else max(indices, default=-1)
        index = 0
        with _capture(self.path, self.upright) as capture:
            while index <= last and capture.grab():
                if indices is None or index in indices:
                    seconds = capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
                    success, image = capture.retrieve()
                    if not success:
                        break
                    if image.shape != (self.size[1], self.size[0], 3) or image.dtype != np.uint8:
                        raise UnreadableImage(
                            f"{self.path.name}: frame {index} differs in size or depth from {self.size[0]}x"
                            f"{self.size[1]} of 8 bits; split the video into parts of equal frames"
                        )
                    yield Frame(index, seconds, np.asarray(image, np.uint8))
                index += 1
        if index == 0 and last >= 0:
            raise UnreadableImage(f"{self.path.name}: no frame can be decoded; {FFMPEG_HINT.format(self.path.name)}")


@contextmanager
def _capture(path: Path, upright: bool) -> Generator[Any]:
    import cv2

    # Use FFmpeg and an absolute path only: other backends interpret a name with % as an image sequence, and a name
    # with a colon as a URL. FFmpeg prints errors to the terminal and reads its log level when it is first used.
    with _open_lock:
        log_level = os.environ.get("OPENCV_FFMPEG_LOGLEVEL")
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
        log: Any = cv2 if hasattr(cv2, "setLogLevel") else cv2.utils.logging  # OpenCV 4, OpenCV 5
        level = log.getLogLevel()
        log.setLogLevel(0)
        try:
            capture = cv2.VideoCapture(str(path.resolve()), cv2.CAP_FFMPEG)
        except cv2.error:
            capture = None
        finally:
            log.setLogLevel(level)
            if log_level is None:
                del os.environ["OPENCV_FFMPEG_LOGLEVEL"]
    if capture is None or not capture.isOpened():
        raise UnreadableImage(f"{path.name}: OpenCV cannot decode this video; {FFMPEG_HINT.format(path.name)}")
    try:
        capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, float(upright))
        yield capture
    finally:
        capture.release()


def _find_defect(path: Path) -> str | None:
    """Return why a file must not be decoded, or None.

    Only known containers are decoded, since decoders also follow playlists, which refer to other files.
    """
    try:
        with path.open("rb") as file:
            head = file.read(400)
            if not head:
                return "empty file; copy it from the camera again"
            if head[4:8] in (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip"):
                return None if _has_index(file) else "no index (moov): the recording or the copy is truncated"
    except FileNotFoundError:
        return "no such file"
    except OSError as error:
        return error.strerror or str(error)
    is_video = (
        (head.startswith(b"RIFF") and head[8:12] == b"AVI ")
        or head.startswith((b"\x1aE\xdf\xa3", b"\0\0\1\xba", b"\0\0\1\xb3", b"\x30\x26\xb2\x75\x8e\x66\xcf\x11"))
        # MPEG transport streams, without and with time stamps (M2TS).
        or (head[0] == 0x47 and head[188:189] == b"\x47")
        or (head[4] == 0x47 and head[196:197] == b"\x47" if len(head) > 196 else False)
    )
    return None if is_video else f"not a video (starts with {head[:5]!r})"


def _avi_frame_count(head: bytes) -> int:
    """Read the number of frames from an AVI header, or 0; FFmpeg does not report it for a truncated file."""
    return int.from_bytes(head[48:52], "little") if head[8:12] == b"AVI " and head[24:28] == b"avih" else 0


def _has_index(file: Any) -> bool:
    """Return whether an MP4 or MOV file (ISO/IEC 14496-12) has a complete moov box."""
    end, at = file.seek(0, os.SEEK_END), 0
    for _ in range(MAX_MP4_BOXES):
        file.seek(at)
        head = file.read(16)
        if len(head) < 8:
            return False
        length = int.from_bytes(head[:4], "big")
        if length == 1:
            length = int.from_bytes(head[8:16], "big")
        at = end if length == 0 else at + length
        if head[4:8] == b"moov":
            return at <= end
        if length < 8 and length != 0:
            return False
    return False
