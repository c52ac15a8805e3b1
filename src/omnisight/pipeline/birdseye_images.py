"""The images, folders or clips of a rig, one for each camera."""

import re
from collections.abc import Generator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.images import VIDEO_SUFFIXES, Clip, collect_images, read_image

Image = NDArray[Any]
# Extension of a clip that every player decodes, and its codec.
CLIP_SUFFIX, CLIP_CODEC = ".mp4", "mp4v"


def match_cameras(sources: Sequence[Path], names: Sequence[str]) -> list[Path]:
    """Return the source of each camera: the file or folder that has its name, alone or as a word (front_017.jpg).

    Raises
    ------
    ValueError
        If a camera has no source or several, or a source belongs to no camera.
    """
    found: dict[str, list[Path]] = {name: [] for name in names}
    for source in sources:
        found[match_camera(source, names)].append(source)
    for name, of_camera in found.items():
        if len(of_camera) > 1:
            raise ValueError(f"{of_camera[0]} and {of_camera[1]} are both of camera {name}: specify one, or folders")
    missing = [name for name, of_camera in found.items() if not of_camera]
    if missing:
        raise ValueError(
            f"no image of camera {', '.join(missing)} among the {len(sources)} images; the rig has"
            f" {len(names)} cameras: {', '.join(names)}"
        )
    return [found[name][0] for name in names]


def match_camera(source: Path, names: Sequence[str]) -> str:
    """Return the name of the camera that a file or folder has as its name, or as a word in it.

    Raises
    ------
    ValueError
        If there is no such camera, or several.
    """
    stem = source.name if source.is_dir() else source.stem
    exact = [name for name in names if name.casefold() == stem.casefold()]
    words = [name for name in names if re.search(rf"(?<![^\W_]){re.escape(name)}(?![^\W_])", stem, re.IGNORECASE)]
    matches = exact or words
    if len(matches) != 1:
        problem = "no camera" if not matches else " and ".join(matches)
        raise ValueError(
            f"{source}: has the name of {problem}; name images, folders and clips after the cameras of the rig:"
            f" {', '.join(names)}"
        )
    return matches[0]


def is_sequence(source: Path) -> bool:
    """Return whether a source is a folder or a clip."""
    return source.is_dir() or source.suffix.lower() in VIDEO_SUFFIXES


def frame_count(sources: Sequence[Path]) -> int:
    """Return the number of frames that all sources have; 0 if it is unknown.

    Raises
    ------
    ValueError
        If folders have different numbers of images, or some sources are single images and others are not.
    """
    single = [source for source in sources if not is_sequence(source)]
    if single and len(single) < len(sources):
        raise ValueError(f"{single[0]}: is one image, others are clips or folders: specify the same for all cameras")
    counts: dict[Path, int] = {}
    for source in sources:
        if source.is_dir():
            counts[source] = len(collect_images([source]))
        else:
            counts[source] = 1 if source in single else Clip.open(source).declared_frames or 0
    folders = {path: count for path, count in counts.items() if path.is_dir()}
    if len(set(folders.values())) > 1:
        listed = ", ".join(f"{path} {count}" for path, count in folders.items())
        raise ValueError(f"the folders have different numbers of images ({listed}): remove those without counterpart")
    return min(counts.values())


def frames(source: Path, apply_exif: bool) -> Generator[Image]:
    """Return the images of a file, a folder or a clip one after the other."""
    if source.suffix.lower() in VIDEO_SUFFIXES and not source.is_dir():
        with closing(Clip.open(source).frames()) as decoded:
            for frame in decoded:
                yield frame.image
        return
    for path in collect_images([source]):
        yield read_image(path, apply_exif=apply_exif)


def moments(sources: Sequence[Path], apply_exif: bool) -> Generator[tuple[Image, ...]]:
    """Return the simultaneous images of all sources, until the shortest ends; the next ones are read meanwhile."""
    streams = [frames(source, apply_exif) for source in sources]
    with ThreadPoolExecutor(len(streams)) as pool:
        following = [pool.submit(next, stream, None) for stream in streams]
        while True:
            images = [future.result() for future in following]
            present = [image for image in images if image is not None]
            if len(present) < len(images):
                return
            following = [pool.submit(next, stream, None) for stream in streams]
            yield tuple(present)


def load_masks(folder: Path | None, names: Sequence[str], sizes: Mapping[str, tuple[int, int]]) -> list[Any]:
    """Return the mask (H, W) of each camera, None without one.

    Raises
    ------
    ValueError
        If the folder has no masks, or one is not of the size of its camera.
    """
    from omnisight.images import read_mask

    if folder is None:
        return [None] * len(names)
    if not folder.is_dir():
        raise ValueError(f"{folder}: is no folder; --masks is a folder with an image for each camera: {names[0]}.png")
    files = {path.stem.casefold(): path for path in sorted(folder.iterdir()) if path.is_file()}
    masks = [read_mask(files[n.casefold()], sizes[n]) if n.casefold() in files else None for n in names]
    if all(mask is None for mask in masks):
        raise ValueError(f"{folder}: has no image with the name of a camera: {', '.join(names)}")
    return masks


@contextmanager
def clip_writer(path: Path, size: tuple[int, int], frame_rate: float) -> Generator[Any]:
    """Return a function that appends RGB images (H, W, 3) to a video file.

    Raises
    ------
    ValueError
        If the file cannot be written.
    """
    import cv2

    # Video codecs need even sizes.
    width, height = size[0] // 2 * 2, size[1] // 2 * 2
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*CLIP_CODEC), frame_rate, (width, height))
    if not writer.isOpened():
        raise ValueError(f"{path}: no video can be written there; choose a name that ends in {CLIP_SUFFIX}")
    try:
        yield lambda image: writer.write(np.ascontiguousarray(image[:height, :width, ::-1]))
    finally:
        writer.release()
