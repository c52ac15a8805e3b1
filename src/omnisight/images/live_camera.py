"""Frames of a connected camera, always the newest."""

import queue
import threading
import time
from collections.abc import Generator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.images.opencv_log import quiet_opencv
from omnisight.images.read import UnreadableImage

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
    """A camera that the operating system offers under a number.

    Attributes
    ----------
    number
        0 is the first camera.
    size
        (width, height) of its frames, px.
    """

    def __init__(self, number: int) -> None:
        """Open the camera.

        Raises
        ------
        UnreadableImage
            If there is no such camera, or it delivers no frame.
        """
        import cv2

        self.number = number
        with quiet_opencv():
            self._capture: Any = cv2.VideoCapture(number)
            self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
            success, first = self._capture.read()
        if not success:
            self._capture.release()
            raise UnreadableImage(f"camera {number}: delivers no image; is it connected, and free of other programs?")
        self.size = int(first.shape[1]), int(first.shape[0])

    def frames(self) -> Generator[CameraFrame]:
        """Read frames until the camera ends; those that arrive while one is processed are dropped but the newest.

        Raises
        ------
        UnreadableImage
            If the camera delivers no frame for some seconds.
        """
        newest: queue.Queue[tuple[float, Any]] = queue.Queue(1)
        ended = threading.Event()
        thread = threading.Thread(target=self._read, args=(newest, ended), daemon=True)
        thread.start()
        start, index = time.monotonic(), 0
        try:
            while True:
                try:
                    seconds, image = newest.get(timeout=TIMEOUT_S)
                except queue.Empty:
                    raise UnreadableImage(f"camera {self.number}: no image for {TIMEOUT_S:g} s") from None
                if image is None:
                    return
                rgb = image if image.ndim == 2 else np.ascontiguousarray(image[..., ::-1])
                yield CameraFrame(index, seconds - start, rgb)
                index += 1
        finally:
            ended.set()
            _empty(newest)  # the thread may wait to add the end
            thread.join(TIMEOUT_S)
            self._capture.release()

    def _read(self, newest: "queue.Queue[tuple[float, Any]]", ended: threading.Event) -> None:
        """Replace the frame in the queue by each new one; None at the end."""
        while not ended.is_set():
            success, image = self._capture.read()
            if not success:
                newest.put((time.monotonic(), None))
                return
            _empty(newest)
            newest.put((time.monotonic(), image))


def _empty(newest: "queue.Queue[tuple[float, Any]]") -> None:
    """Remove the frame from the queue."""
    with suppress(queue.Empty):
        newest.get_nowait()
