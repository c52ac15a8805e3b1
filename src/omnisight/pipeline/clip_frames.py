"""Frames of a video clip as image files: the counterpart of `omnisight reconstruct clip.mp4`."""

from collections.abc import Callable
from os import PathLike
from pathlib import Path

import numpy as np

from omnisight.images import Clip, Frame, write_image

# Width, px, of the thumbnails whose sharpness is compared.
THUMBNAIL_WIDTH_PX = 640


def extract_frames(
    clip: str | PathLike[str],
    folder: str | PathLike[str],
    fps: float = 2.0,
    progress: Callable[[str, int, int], None] = lambda stage, done, total: None,
) -> list[Path]:
    """Write the sharpest frame of each interval of a video clip as a JPEG file.

    Frame 123 of `clip.mp4` becomes `clip-000123.jpg`; the first is 0.

    Parameters
    ----------
    clip
        The video file.
    folder
        Folder of the images; it is created.
    fps
        Images per second of the clip.
    progress
        Called with the stage, the frames read and their number.

    Returns
    -------
    The files, in the order of the clip.

    Raises
    ------
    ValueError
        If the clip cannot be decoded, or `fps` is not positive.
    OSError
        If a file cannot be written.
    """
    if not fps > 0:
        raise ValueError(f"fps is {fps:g}; choose a positive number of images per second")
    video, target = Clip.open(Path(clip)), Path(folder)
    length, total = max(video.frame_rate / fps, 1.0), video.declared_frames or 0
    target.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []

    def write(frame: Frame | None) -> None:
        if frame is not None:
            written.append(target / f"{video.path.stem}-{frame.index:06d}.jpg")
            write_image(written[-1], frame.image)

    sharpest, most, interval = None, 0.0, 0
    for frame in video.frames():
        if int(frame.index / length) > interval:
            write(sharpest)
            sharpest, interval = None, int(frame.index / length)
        sharpness = _sharpness(frame)
        if sharpest is None or sharpness > most:
            sharpest, most = frame, sharpness
        progress("frames of the clip", frame.index + 1, max(total, frame.index + 1))
    write(sharpest)
    return written


def _sharpness(frame: Frame) -> float:
    """Return the variance of the Laplacian of a thumbnail."""
    import cv2

    scale = min(THUMBNAIL_WIDTH_PX / frame.gray.shape[1], 1.0)
    small = cv2.resize(frame.gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return float(np.var(cv2.Laplacian(small, cv2.CV_32F)))
