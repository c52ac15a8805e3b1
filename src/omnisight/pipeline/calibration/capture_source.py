"""Sources of frames of the capture: a connected camera, a clip, or a folder of images."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from omnisight.images import Clip, UnreadableImage, collect_images, has_clip_suffix, read_image
from omnisight.images.live_camera import CameraFrame, LiveCamera
from omnisight.targets.clip_detection import INTERVAL_S, CandidateFrame, best_of_intervals

# Frames per second of a connected camera: drivers report wrong rates, and few cameras have fewer.
LIVE_FRAME_RATE = 30.0


@dataclass(frozen=True)
class CaptureSource:
    """Candidates for calibration images, in the order of time.

    Attributes
    ----------
    label
        Name in messages.
    candidates
        The sharpest and stillest frame of each short interval, or all images of a folder.
    """

    label: str
    candidates: Iterable[CandidateFrame]

    @classmethod
    def open(cls, source: str, *, apply_exif: bool = False) -> "CaptureSource":
        """Open a source.

        Parameters
        ----------
        source
            Number of a connected camera, clip, or folder of images.
        apply_exif
            Rotate images by their EXIF orientation, and frames as the clip specifies for display.

        Raises
        ------
        ValueError
            If there is no such camera or file.
        """
        if source.isdigit():
            frames = LiveCamera(int(source)).frames()
            return cls(f"camera {source}", best_of_intervals(frames, round(LIVE_FRAME_RATE * INTERVAL_S)))
        paths = collect_images([source], videos=True)
        if len(paths) == 1 and has_clip_suffix(paths[0]):
            clip = Clip.open(paths[0], upright=apply_exif)
            interval = max(round(clip.frame_rate * INTERVAL_S), 1)
            return cls(source, best_of_intervals(clip.frames(), interval))
        if clips := [path for path in paths if has_clip_suffix(path)]:
            raise ValueError(f"{source}: contains clips, such as {clips[0].name}: specify one, or a folder of images")
        return cls(source, _of_images(paths, apply_exif))


def _of_images(paths: list[Path], apply_exif: bool) -> Iterator[CandidateFrame]:
    """Yield every image that can be read, as one of an interval of its own: the board was still when it was taken."""
    for index, path in enumerate(paths):
        try:
            image = read_image(path, apply_exif=apply_exif)
        except UnreadableImage:
            continue
        yield next(best_of_intervals([CameraFrame(index, float(index), image)], 1))
