"""Simultaneous images of several lenses: files, folders, clips, or two circles side by side in one image."""

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.images import (
    Clip,
    Frame,
    check_frame_rates,
    collect_images,
    downsample,
    estimate_image_field,
    has_clip_suffix,
    read_image,
    to_gray8,
)
from omnisight.images.image_field import ImageField
from omnisight.images.output_paths import unique_stems
from omnisight.parallel import prefetch
from omnisight.pipeline.inputs.image_set import ImageSet, image_folders, image_set
from omnisight.sfm.head_problem import LensField

Bytes = NDArray[np.uint8]
StitchSource = str | PathLike[str] | NDArray[Any]

# Frames of a sequence from which lenses and rotation are estimated: more take longer and change little.
MAX_CALIBRATION_FRAMES = 6
# Relative difference of the radii of both circles above which one is wrong: both lenses of a head have the same model.
MAX_RADIUS_DIFFERENCE = 0.02
# Names of the lenses of a head in a single folder.
HEAD_NAMES = ("front", "back")


def read_source(source: StitchSource, apply_exif: bool) -> NDArray[Any]:
    """Return an image, read if it is a file."""
    return source if isinstance(source, np.ndarray) else read_image(Path(source), apply_exif=apply_exif)


@dataclass(frozen=True, eq=False)
class HeadFrames:
    """Frames of simultaneous images.

    Attributes
    ----------
    sources
        For each frame its images, one per lens; a single one if it shows both lenses. Clips: one frame.
    is_clip
        Whether the sources are clips.
    is_split
        Whether an image shows two lenses side by side.
    labels
        Different name of each frame.
    apply_exif
        Rotate images by their EXIF orientation, and frames as the clip specifies for display.
    read
        Reads the image of a source; its second argument is `apply_exif`.
    """

    sources: tuple[tuple[StitchSource, ...], ...]
    is_clip: bool
    is_split: bool
    labels: tuple[str, ...]
    apply_exif: bool = False
    read: Callable[[StitchSource, bool], NDArray[Any]] = read_source

    @property
    def first(self) -> str:
        """Names of the first images, or of the clips, in messages."""
        sources = enumerate(self.sources[0], start=1)
        return ", ".join(f"image {k}" if isinstance(source, np.ndarray) else str(source) for k, source in sources)

    def __iter__(self) -> Iterator[list[Bytes]]:
        """Read the images of each frame, RGB."""
        if not self.is_clip:
            yield from (self._read(frame) for frame in self.sources)
            return
        with closing(self.clip_frames()) as moments:
            yield from (self.images(frames) for frames in moments)

    @cached_property
    def clips(self) -> list[Clip]:
        """The clips."""
        return [Clip.open(Path(str(source)), upright=self.apply_exif) for source in self.sources[0]]

    def clip_frames(self) -> Generator[tuple[Frame, ...]]:
        """Decode the simultaneous frames of clips, each on a thread, until the shortest ends."""
        with ExitStack() as stack:
            streams = [stack.enter_context(closing(prefetch(clip.frames(limit=None)))) for clip in self.clips]
            yield from zip(*streams, strict=False)

    def images(self, frames: Sequence[Frame]) -> list[Bytes]:
        """Return the image of each camera of simultaneous frames."""
        return self._split([frame.image for frame in frames])

    @property
    def count(self) -> int:
        """Number of frames; of a clip that of its header, at least 1."""
        if not self.is_clip:
            return len(self.sources)
        return max(1, min(clip.declared_frames or 1 for clip in self.clips))

    def calibration_frames(self) -> list[list[Bytes]]:
        """Return a few frames, evenly distributed."""
        chosen = set(np.unique(np.linspace(0, self.count - 1, MAX_CALIBRATION_FRAMES).round().astype(int)).tolist())
        if not self.is_clip:
            return [self._read(self.sources[k]) for k in sorted(chosen)]
        together = zip(*(clip.frames(chosen) for clip in self.clips), strict=False)
        return [self.images(frames) for frames in together]

    def _read(self, sources: Sequence[StitchSource]) -> list[Bytes]:
        return self._split([self.read(source, self.apply_exif) for source in sources])

    def _split(self, images: Sequence[NDArray[Any]]) -> list[Bytes]:
        colors = [rgb8(image) for image in images]
        if not self.is_split:
            return colors
        half = colors[0].shape[1] // 2
        return [np.ascontiguousarray(colors[0][:, :half]), np.ascontiguousarray(colors[0][:, half : 2 * half])]


def head_frames(images: Sequence[StitchSource], names: Sequence[str] = ()) -> HeadFrames:
    """Return the frames of images, folders, clips, or of a single image with two circles.

    Parameters
    ----------
    images
        One source per lens; or one with two circles side by side, or a folder with the images of all lenses.
    names
        Names of the lenses in a single folder; by default front and back.

    Raises
    ------
    ValueError
        If there are no images, or the sources have different numbers of images or frame rates.
    """
    if not images:
        raise ValueError("specify the images of the lenses, such as front.jpg back.jpg")
    paths = [Path(s) if not isinstance(s, np.ndarray) else None for s in images]
    is_folder = [path is not None and path.is_dir() for path in paths]
    if any(is_folder) and not all(is_folder):
        raise ValueError("specify images or folders of all lenses, not both")
    if len(images) == 1 and all(is_folder):
        found = image_set(str(images[0]), names or HEAD_NAMES, is_rig=True)
        return frames_of_folder(found, images[0], names or HEAD_NAMES)
    if all(is_folder):
        return frames_of_folders(images, [collect_images(image_folders(folder)) for folder in paths if folder])
    clips = [path is not None and has_clip_suffix(path) for path in paths]
    if any(clips) and not all(clips):
        raise ValueError("specify images or clips of all lenses, not both")
    label = Path(str(images[0])).stem if paths[0] is not None else "image"
    is_split = len(images) == 1
    if is_split and len(names) == 1:
        raise ValueError("the rig has one camera: a single image needs no stitching, use omnisight view")
    frames = HeadFrames((tuple(images),), all(clips), is_split, (label,))
    if frames.is_clip:
        check_frame_rates(frames.clips)
    return frames


def lens_fields(frames: HeadFrames, samples: Sequence[Sequence[Bytes]]) -> tuple[LensField, LensField]:
    """Return the image fields of two lenses of a head, from the images of some frames.

    Raises
    ------
    ValueError
        If a lens shows no image circle.
    """
    found = [
        _rescaled_field([downsample(to_gray8(frame[k])) for frame in samples], samples[0][k].shape) for k in range(2)
    ]
    missing = [k for k, field in enumerate(found) if field.outer is None]
    if len(missing) == 2 or (missing and frames.is_split):
        raise ValueError(
            f"{frames.first}: no two image circles were detected"
            + (" side by side" if frames.is_split else "")
            + "; without image circles specify a calibrated rig (--rig)"
        )
    if missing or found[0].size == found[1].size:
        return _common_circle(found)
    return LensField(found[0]), LensField(found[1])


def _rescaled_field(grays: Sequence[NDArray[np.uint8]], shape: tuple[int, ...]) -> ImageField:
    return estimate_image_field(grays).resized((shape[1], shape[0]))


def _common_circle(fields: list[ImageField]) -> tuple[LensField, LensField]:
    """Replace a missing or too large circle by that of the other lens: glare beyond the rim enlarges it."""
    radii = [field.outer.radius if field.outer else np.inf for field in fields]
    limit = min(radii) * (1 + MAX_RADIUS_DIFFERENCE)
    smaller = fields[int(np.argmin(radii))]
    first, second = (
        LensField(field) if radius <= limit else _centered(smaller.resized(field.size))
        for field, radius in zip(fields, radii, strict=True)
    )
    return first, second


def _centered(field: ImageField) -> LensField:
    """Return the field of another lens in the centre of the image: both are not decentered alike."""
    width, height = field.size
    circle = replace(LensField(field).circle, centre=((width - 1) / 2, (height - 1) / 2))
    return LensField(replace(field, outer=circle), is_own=False)


def frames_of_folder(found: ImageSet, folder: StitchSource, names: Sequence[str]) -> HeadFrames:
    """Return the frames of a folder with the images of all lenses."""
    frames: list[tuple[StitchSource, ...]] = []
    for frame in np.unique(found.frame):
        of = {int(found.camera[i]): found.paths[i] for i in np.flatnonzero(found.frame == frame)}
        if len(of) == len(names):
            frames.append(tuple(of[k] for k in range(len(names))))
    if not frames:
        raise ValueError(f"{folder}: no frame has an image of each of {', '.join(names)}")
    return HeadFrames(tuple(frames), False, False, tuple(unique_stems([Path(str(f[0])) for f in frames])))


def frames_of_folders(folders: Sequence[StitchSource], lists: Sequence[Sequence[Path]]) -> HeadFrames:
    """Return the frames of a folder for each lens, in natural order."""
    counts = [len(files) for files in lists]
    if len(set(counts)) > 1:
        listed = ", ".join(f"{folder}: {count}" for folder, count in zip(folders, counts, strict=True))
        raise ValueError(
            f"the folders have different numbers of images ({listed}), and are not simultaneous: leave out the"
            " images of times at which another camera has none"
        )
    frames = tuple(tuple(files) for files in zip(*lists, strict=True))
    return HeadFrames(frames, False, len(folders) == 1, tuple(unique_stems([frame[0] for frame in frames])))


def rgb8(image: NDArray[Any]) -> Bytes:
    """Return an image as (H, W, 3) of uint8: of 16 bits per channel, the upper ones."""
    if image.ndim == 3 and image.dtype.kind == "u":
        return np.ascontiguousarray(image[..., :3] >> (8 * (image.itemsize - 1)), np.uint8)
    return np.repeat(to_gray8(image)[..., None], 3, axis=2)
