"""The images, folders or clips of a rig, one for each camera."""

from collections.abc import Generator, Mapping, Sequence
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from omnisight.images import Clip, check_frame_rates, collect_images, has_clip_suffix, read_image, read_mask
from omnisight.parallel import prefetch
from omnisight.pipeline.inputs.image_set import camera_of, image_folders

Image = NDArray[Any]
# Frames per second of a video of folders.
FOLDER_FPS = 30.0


def match_cameras(sources: Sequence[Path], names: Sequence[str]) -> list[Path]:
    """Return the source of each camera: the file, folder or clip whose path has its name; see `camera_of`.

    Raises
    ------
    ValueError
        If a camera has no source or several, or a source belongs to no camera.
    """
    found: dict[str, list[Path]] = {name: [] for name in names}
    for source in sources:
        found[camera_name(source, names)].append(source)
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


def camera_name(source: Path, names: Sequence[str]) -> str:
    """Return the name of the camera of a source; that of the only camera does not need to be in the path."""
    return names[0] if len(names) == 1 else names[camera_of(source, names)]


def check_order(sources: Sequence[Any], names: Sequence[str]) -> None:
    """Raise `ValueError` if the names of images are those of all cameras, but in another order."""
    found: list[str] = []
    for source in sources:
        with suppress(ValueError, TypeError):  # arrays, and files that are not named after cameras
            found.append(camera_name(Path(source), names))
    if found != list(names) and sorted(found) == sorted(names):
        order, expected = (", ".join(each) for each in (found, names))
        raise ValueError(f"the images are in the order {order}, and the cameras of the rig in the order {expected}")


def is_sequence(source: Path) -> bool:
    """Return whether a source is a folder or a clip."""
    return source.is_dir() or has_clip_suffix(source)


def frame_count(sources: Sequence[Path]) -> int:
    """Return the number of frames that all sources have; 0 if it is unknown.

    Raises
    ------
    ValueError
        If folders have different numbers of images, clips have different frame rates, or some sources are single images
        and others are not.
    """
    single = [source for source in sources if not is_sequence(source)]
    if single and len(single) < len(sources):
        raise ValueError(f"{single[0]}: is one image, others are clips or folders: specify the same for all cameras")
    if single:
        return 1
    folders = {source: len(collect_images(image_folders(source))) for source in sources if source.is_dir()}
    clips = [Clip.open(source) for source in sources if source not in folders]
    check_frame_rates(clips)
    if len(set(folders.values())) > 1:
        listed = ", ".join(f"{path} {count}" for path, count in folders.items())
        raise ValueError(f"the folders have different numbers of images ({listed}): remove those without counterpart")
    return min([*folders.values(), *(clip.declared_frames or 0 for clip in clips)])


def frames(source: Path, apply_exif: bool) -> Generator[tuple[Image, float]]:
    """Return the images of a file, a folder or a clip one after the other, and their times, seconds."""
    if has_clip_suffix(source):
        with closing(Clip.open(source, upright=apply_exif).frames(limit=None)) as decoded:
            for frame in decoded:
                yield frame.image, frame.seconds
        return
    for k, path in enumerate(collect_images(image_folders(source))):
        yield read_image(path, apply_exif=apply_exif), k / FOLDER_FPS


def moments(sources: Sequence[Path], apply_exif: bool) -> Generator[tuple[tuple[Image, ...], float]]:
    """Return the simultaneous images of all sources and the time of the first, until the shortest ends.

    The next ones are read meanwhile.
    """
    streams = [prefetch(frames(source, apply_exif), 1) for source in sources]
    with ExitStack() as stack:
        for stream in streams:
            stack.enter_context(closing(stream))
        for together in zip(*streams, strict=False):
            yield tuple(image for image, _ in together), together[0][1]


def load_masks(folder: Path | None, names: Sequence[str], sizes: Mapping[str, tuple[int, int]]) -> list[Any]:
    """Return the mask (H, W) of each camera, None without one.

    Raises
    ------
    ValueError
        If the folder has no masks, or one is not of the size of its camera.
    """
    if folder is None:
        return [None] * len(names)
    if not folder.is_dir():
        raise ValueError(f"{folder}: is no folder; --masks is a folder with an image for each camera: {names[0]}.png")
    files = {path.stem.casefold(): path for path in sorted(folder.iterdir()) if path.is_file()}
    masks = [read_mask(files[n.casefold()], sizes[n]) if n.casefold() in files else None for n in names]
    if all(mask is None for mask in masks):
        raise ValueError(f"{folder}: has no image with the name of a camera: {', '.join(names)}")
    return masks


def read_masks(path: Path | None, names: Sequence[str], sizes: Sequence[tuple[int, int]]) -> list[Any]:
    """Return the mask of each camera: that of all, or the file with its name in a folder; None if there is none.

    Raises
    ------
    ValueError
        If a mask cannot be read, or a folder does not have one for a camera of each name, or for the only camera.
    """
    if path is None or not path.is_dir():
        return [None if path is None else read_mask(path, size) for size in sizes]
    if names:
        return load_masks(path, names, dict(zip(names, sizes, strict=True)))
    files = [file for file in sorted(path.iterdir()) if file.is_file()]
    if len(files) != 1:
        raise ValueError(f"{path}: contains {len(files)} files: specify the file of the mask of the camera")
    return [read_mask(files[0], sizes[0])]
