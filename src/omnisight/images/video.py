"""Reads the frames of a clip one after another, or says in one line why it cannot."""

from __future__ import annotations

import os
import threading
from collections.abc import Collection, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .read import UnreadableImage

CLIPS = (".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".mpg", ".mpeg", ".mts", ".m2ts", ".wmv", ".insv", ".360")
MOST_PIXELS = 10**8
# Frames that are read: eleven minutes at thirty a second. No calibration needs more, and a run must end.
MOST_FRAMES = 20_000
_MOST_BOXES = 1000

_opening = threading.Lock()


@dataclass(frozen=True, eq=False)
class Frame:
    """A picture of a clip.

    Attributes
    ----------
    index : int
        From 0.
    seconds : float
        Since the clip's start, as the file says.
    bgr : (H, W, 3) array of uint8
        As the decoder gives it: blue, green, red.
    """

    index: int
    seconds: float
    bgr: NDArray[np.uint8]

    @property
    def image(self) -> NDArray[np.uint8]:
        """(H, W, 3) RGB."""
        return self.bgr[..., ::-1]

    @property
    def gray(self) -> NDArray[np.uint8]:
        """(H, W) what `to_gray8` makes of the image."""
        import cv2

        return np.asarray(cv2.cvtColor(self.bgr, cv2.COLOR_BGR2GRAY), np.uint8)


@dataclass(frozen=True)
class Clip:
    """A video file.

    Attributes
    ----------
    path : Path
    size : (int, int)
        Width and height of its frames, px.
    rate : float
        Frames per second; 30 where the file does not say.
    declared : int or None
        Frames that it says it has, which may be wrong; None where it does not say.
    rotation_deg : int
        By how much it asks to be turned when shown: a multiple of 90.
    upright : bool
        Whether that is done. A calibration belongs to the sensor, which does not turn with the camera.
    """

    path: Path
    size: tuple[int, int]
    rate: float
    declared: int | None
    rotation_deg: int
    upright: bool

    @classmethod
    def open(cls, path: str | Path, *, upright: bool = False) -> Clip:
        """Look at a file's header.

        Raises
        ------
        UnreadableImage
            If the file is missing, empty, cut short before its index, no video, or in a coding that is not known.
        """
        import cv2

        path = Path(path)
        fault = _fault(path)
        if fault is not None:
            raise UnreadableImage(f"{path.name}: {fault}")
        with path.open("rb") as file:
            told = _frames_of_avi(file.read(52))
        with _capture(path, upright) as capture:
            width, height = (int(capture.get(p)) for p in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
            rate, count = capture.get(cv2.CAP_PROP_FPS), capture.get(cv2.CAP_PROP_FRAME_COUNT)
            rotation = int(capture.get(cv2.CAP_PROP_ORIENTATION_META)) % 360
        if width * height > MOST_PIXELS:
            raise UnreadableImage(
                f"{path.name}: frames of {width} x {height} pixels, more than the {MOST_PIXELS:.0e} that are read"
            )
        return cls(
            path,
            (width, height),
            rate if 1 <= rate <= 10_000 else 30.0,
            max(told, int(count) if count < 1e9 else 0, 0) or None,
            rotation,
            upright,
        )

    def frames(self, wanted: Collection[int] | None = None) -> Generator[Frame]:
        """Give frames in order, each decoded when it is asked for: all up to `MOST_FRAMES`, or the `wanted` indices.

        Raises
        ------
        UnreadableImage
            If none can be decoded, or their size changes.
        """
        import cv2

        last = MOST_FRAMES - 1 if wanted is None else max(wanted, default=-1)
        index = 0
        with _capture(self.path, self.upright) as capture:
            while index <= last and capture.grab():
                if wanted is None or index in wanted:
                    seconds = capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
                    done, image = capture.retrieve()
                    if not done:
                        break
                    if image.shape != (self.size[1], self.size[0], 3) or image.dtype != np.uint8:
                        raise UnreadableImage(
                            f"{self.path.name}: frame {index} has another size or depth than {self.size[0]}x"
                            f"{self.size[1]} of 8 bits; cut the clip into parts of one kind"
                        )
                    yield Frame(index, seconds, np.asarray(image, np.uint8))
                index += 1
        if index == 0 and last >= 0:
            raise UnreadableImage(f"{self.path.name}: no frame can be decoded; {_CONVERT.format(self.path.name)}")


_CONVERT = "convert it, such as by: ffmpeg -i {} -c:v libx264 -crf 10 clip.mp4"


@contextmanager
def _capture(path: Path, upright: bool) -> Generator[Any]:
    import cv2

    # FFmpeg alone, and an absolute path: other readers take a name with % for a series of pictures, and a name with
    # a colon for an address. What it dislikes in a file it prints; when it is first used it reads how much of that.
    with _opening:
        told = os.environ.get("OPENCV_FFMPEG_LOGLEVEL")
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
            if told is None:
                del os.environ["OPENCV_FFMPEG_LOGLEVEL"]
    if capture is None or not capture.isOpened():
        raise UnreadableImage(f"{path.name}: a video that OpenCV cannot decode; {_CONVERT.format(path.name)}")
    try:
        capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, float(upright))
        yield capture
    finally:
        capture.release()


def _fault(path: Path) -> str | None:
    """Say what is wrong with a file before a decoder sees it: nothing but known containers gets there.

    Decoders also know playlists, which name other files.
    """
    try:
        with path.open("rb") as file:
            head = file.read(400)
            if not head:
                return "empty file; copy it again from the camera"
            if head[4:8] in (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip"):
                return None if _has_index(file) else "no index (moov): the recording or the copy was cut short"
    except FileNotFoundError:
        return "no such file"
    except OSError as error:
        return error.strerror or str(error)
    known = (
        (head.startswith(b"RIFF") and head[8:12] == b"AVI ")
        or head.startswith((b"\x1aE\xdf\xa3", b"\0\0\1\xba", b"\0\0\1\xb3", b"\x30\x26\xb2\x75\x8e\x66\xcf\x11"))
        or (head[0] == 0x47 and head[188:189] == b"\x47")  # MPEG transport stream
        or (head[4] == 0x47 and head[196:197] == b"\x47" if len(head) > 196 else False)  # the same with times: M2TS
    )
    return None if known else f"not a video (starts with {head[:5]!r})"


def _frames_of_avi(head: bytes) -> int:
    """Read how many frames an AVI file was made with, which FFmpeg does not tell of one that was cut short; or 0."""
    return int.from_bytes(head[48:52], "little") if head[8:12] == b"AVI " and head[24:28] == b"avih" else 0


def _has_index(file: Any) -> bool:
    """Say whether a file of boxes (ISO/IEC 14496-12), such as MP4 and MOV, has a whole moov."""
    end, at = file.seek(0, os.SEEK_END), 0
    for _ in range(_MOST_BOXES):
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
