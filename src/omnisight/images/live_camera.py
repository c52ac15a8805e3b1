"""Images as they arrive, always the newest: of a connected camera, or of a clip that is played at its rate."""

import queue
import threading
import time
from collections.abc import Generator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from omnisight.images.opencv_log import quiet_opencv
from omnisight.images.read import UnreadableImage
from omnisight.images.video import Clip

# Seconds without a frame after which a camera counts as disconnected.
TIMEOUT_S = 5.0


@dataclass(frozen=True, eq=False)
class CameraFrame:
    """A frame of a camera, of a clip or of a folder.

    Attributes
    ----------
    index
        Its number, from 0.
    seconds
        Time since the first.
    image
        Gray or RGB image (H, W) or (H, W, 3).
    """

    index: int
    seconds: float
    image: NDArray[Any]


class LiveCamera:
    """A camera that the operating system offers under a number, or a clip in its place.

    Attributes
    ----------
    label
        Name in messages.
    size
        (width, height) of its frames, px.
    dropped
        Number of frames that arrived while an earlier one was processed, and were not returned.
    """

    def __init__(self, source: int | Path, *, upright: bool = False) -> None:
        """Open the camera with this number, where 0 is the first, or the clip, rotated as it specifies for display.

        Raises
        ------
        UnreadableImage
            If there is no such camera, or it delivers no frame.
        """
        self._source = _Connected(source) if isinstance(source, int) else _Played(source, upright)
        self.label, self.size, self.dropped = self._source.label, self._source.size, 0

    def close(self) -> None:
        """Release the camera or the clip."""
        self._source.close()

    def frames(self) -> Generator[CameraFrame]:
        """Read frames until the camera ends, and release it.

        Of those that arrive while one is processed, all but the newest are dropped.

        Raises
        ------
        UnreadableImage
            If the camera delivers no frame for some seconds.
        """
        newest: queue.Queue[Timed | None] = queue.Queue(1)
        ended = threading.Event()
        thread = threading.Thread(target=self._read, args=(newest, ended), daemon=True)
        thread.start()
        start, index = None, 0
        try:
            while True:
                try:
                    timed = newest.get(timeout=TIMEOUT_S)
                except queue.Empty:
                    raise UnreadableImage(f"{self.label}: no image for {TIMEOUT_S:g} s") from None
                if timed is None:
                    return
                seconds, image = timed
                start = seconds if start is None else start
                yield CameraFrame(index, seconds - start, image)
                index += 1
        finally:
            ended.set()
            _empty(newest)  # the thread may wait to add the end
            thread.join(TIMEOUT_S)
            self.close()

    def _read(self, newest: "queue.Queue[Timed | None]", ended: threading.Event) -> None:
        """Replace the frame in the queue by each new one; None at the end."""
        while not ended.is_set():
            timed = self._source.read()
            if timed is None:
                newest.put(None)
                return
            self.dropped += _empty(newest)
            newest.put(timed)


Timed = tuple[float, NDArray[Any]]


class _Source(Protocol):
    """Something that delivers frames when they are due."""

    label: str
    size: tuple[int, int]

    def read(self) -> Timed | None:
        """Wait for the next frame and return it with its time, seconds; None at the end."""
        ...

    def close(self) -> None:
        """Release the camera or the file."""
        ...


class _Connected(_Source):
    """A connected camera."""

    def __init__(self, number: int) -> None:
        import cv2

        self.label = f"camera {number}"
        with quiet_opencv():
            self._capture: Any = cv2.VideoCapture(number)
            self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
            success, first = self._capture.read()
        if not success:
            self._capture.release()
            raise UnreadableImage(f"{self.label}: delivers no image; is it connected, and free of other programs?")
        self.size = int(first.shape[1]), int(first.shape[0])

    def read(self) -> Timed | None:
        success, image = self._capture.read()
        if not success:
            return None
        return time.monotonic(), image if image.ndim == 2 else np.ascontiguousarray(image[..., ::-1])

    def close(self) -> None:
        self._capture.release()


class _Played(_Source):
    """A clip whose frames are delivered at their times."""

    def __init__(self, path: Path, upright: bool) -> None:
        clip = Clip.open(path, upright=upright)
        self.label, self.size = str(path), clip.size
        self._frames = clip.frames(limit=None)
        self._start: float | None = None

    def read(self) -> Timed | None:
        frame = next(self._frames, None)
        if frame is None:
            return None
        image, now = frame.image, time.monotonic()
        self._start = now - frame.seconds if self._start is None else self._start
        time.sleep(max(self._start + frame.seconds - now, 0.0))
        return frame.seconds, image

    def close(self) -> None:
        self._frames.close()


def _empty(newest: "queue.Queue[Timed | None]") -> bool:
    """Remove the frame from the queue; return whether there was one."""
    with suppress(queue.Empty):
        newest.get_nowait()
        return True
    return False
