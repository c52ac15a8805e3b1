"""Silence of OpenCV, which prints errors of files and cameras to the terminal."""

import threading
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

_lock = threading.Lock()


@contextmanager
def quiet_opencv() -> Generator[None]:
    """Print nothing from OpenCV.

    Its log level is that of the whole process: one thread at a time sets and restores it.
    """
    import cv2

    with _lock:
        log: Any = cv2 if hasattr(cv2, "setLogLevel") else cv2.utils.logging  # OpenCV 4, OpenCV 5
        level = log.getLogLevel()
        log.setLogLevel(0)
        try:
            yield
        finally:
            log.setLogLevel(level)
