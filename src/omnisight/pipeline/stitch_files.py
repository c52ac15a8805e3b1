"""Output files of a stitch: photos with GPano tags, folders of them, and clips with spherical metadata."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from omnisight.images import IMAGE_SUFFIXES, encode_image, write_bytes
from omnisight.images.gpano import with_gpano
from omnisight.images.output_paths import refuse_overwrite
from omnisight.images.spherical_video import with_spherical_boxes
from omnisight.pipeline.stitch_inputs import Bytes, HeadFrames
from omnisight.pipeline.stitch_options import StitchOptions

# Codec of OpenCV that every build has; no licence is needed.
CODEC = "mp4v"


class SphereWriter:
    """Writes spheres; without a target it does nothing.

    Attributes
    ----------
    files
        The files written.
    """

    def __init__(self, target: Path | None, frames: HeadFrames, options: StitchOptions) -> None:
        self._target, self._frames, self._options = target, frames, options
        self._video: Any = None
        self.files: tuple[Path, ...] = ()

    def write(self, image: Bytes, index: int) -> None:
        """Write the sphere (H, W, 3) of a frame."""
        target = self._target
        if target is None:
            return
        if self._frames.is_clip:
            self._write_frame(target, image)
            return
        path = target / f"{self._frames.labels[index]}.jpg" if self._frames.count > 1 else target
        data = encode_image(image, path.name)
        if path.suffix.lower() in (".jpg", ".jpeg"):
            options = self._options
            is_level = options.level or bool(options.pitch or options.roll)
            data = with_gpano(data, (image.shape[1], image.shape[0]), heading=options.heading, is_level=is_level)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(path, data)
        self.files += (path,)

    def close(self) -> None:
        """Finish a clip and add its metadata."""
        if self._video is not None and self._target is not None:
            self._video.release()
            write_bytes(self._target, with_spherical_boxes(self._target.read_bytes()))
            self.files = (self._target,)

    def _write_frame(self, target: Path, image: Bytes) -> None:
        import cv2

        height, width = image.shape[:2]
        if self._video is None:
            fourcc = cv2.VideoWriter.fourcc(*CODEC)
            self._video = cv2.VideoWriter(str(target), fourcc, self._frames.frame_rate, (width, height))
            if not self._video.isOpened():
                raise ValueError(f"{target}: OpenCV cannot write this video")
        self._video.write(cv2.cvtColor(image, cv2.COLOR_RGB2BGR))


@contextmanager
def sequence_writer(target: Path | None, frames: HeadFrames, options: StitchOptions) -> Generator[SphereWriter]:
    """Return a writer of the spheres of frames, and finish its files."""
    writer = SphereWriter(target, frames, options)
    yield writer
    writer.close()


def check_output(target: Path, frames: HeadFrames) -> Path:
    """Return the output if it fits the frames.

    Raises
    ------
    ValueError
        If its extension does not fit, or it is one of the inputs.
    """
    inputs = [Path(s) for frame in frames.sources for s in frame if isinstance(s, str | Path)]
    refuse_overwrite([target], inputs)
    suffix = target.suffix.lower()
    if frames.is_clip and suffix not in (".mp4", ".mov"):
        raise ValueError(f"{target}: a stitched clip is written as .mp4")
    if not frames.is_clip and len(frames.sources) > 1 and suffix:
        raise ValueError(f"{target}: there are {len(frames.sources)} frames; specify a folder")
    if not frames.is_clip and len(frames.sources) == 1 and suffix not in IMAGE_SUFFIXES:
        raise ValueError(f"{target}: specify an image file, such as sphere.jpg")
    if not target.parent.is_dir():
        raise ValueError(f"{target}: there is no folder {target.parent}; make it first")
    return target
