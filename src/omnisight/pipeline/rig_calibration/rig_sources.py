"""The images of each camera of a rig, by name."""

import glob
import re
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from omnisight.calibration.frame_selection import select_frames, write_frames
from omnisight.images import IMAGE_SUFFIXES, expand_path, has_clip_suffix
from omnisight.images.collect import folders_with_images, natural_sort_key
from omnisight.images.name_patterns import patterns_by_name
from omnisight.pipeline.inputs.image_set import IMAGES
from omnisight.pipeline.rig_calibration.calibrate_rig_options import CalibrateRigOptions
from omnisight.pipeline.rig_calibration.simultaneous_views import (
    MAX_INTERVAL_SHARE,
    frame_times,
    median_interval,
    read_times,
)
from omnisight.progress import Progress

RigSources = Mapping[str, Any]


def named_sources(sources: RigSources | Sequence[str | PathLike[str]]) -> dict[str, Any]:
    """Return the source of each camera by its name.

    The name is that of the folder or clip, the fixed part of a pattern such as 'left*.jpg', or NAME in NAME=SOURCE. If
    these are the same, as of cam0/data and cam1/data, it is that of the folder in which they differ. Each sub-folder
    with images, or each clip, of a single folder is a camera; or else the names of its images divide them by camera,
    such as left1.jpg and right1.jpg.

    Raises
    ------
    ValueError
        If there are fewer than two cameras, two have the same name, or one is a single image.
    MissingFileError
        If the only source does not exist.
    """
    if isinstance(sources, Mapping):
        named = dict(sources)
    else:
        items = [str(item) for item in sources]
        if single := [item for item in items if Path(item).suffix.lower() in IMAGE_SUFFIXES and Path(item).is_file()]:
            raise ValueError(
                f"{single[0]}: one image; specify a folder, a clip or a pattern in quotes for each camera, such as"
                " 'left*.jpg' 'right*.jpg'"
            )
        named = _distinct([_named(item) for item in (_cameras_in(items[0]) if len(items) == 1 else items)])
    if len(named) < 2:
        raise ValueError(
            f"{len(named)} camera{'s' * (len(named) != 1)}, and a rig has at least two: specify a folder, a clip or a"
            " pattern for each, such as left/ right/ or 'left*.jpg' 'right*.jpg', or a folder with a sub-folder, a clip"
            " or numbered images such as left1.jpg and right1.jpg for each (omnisight calibrate is for one)"
        )
    return named


def _cameras_in(item: str) -> list[str]:
    """Return the sub-folders with images of a folder, its clips, or patterns that divide its images by camera.

    The item itself if there are fewer than two.

    Raises
    ------
    MissingFileError
        If the item does not exist.
    """
    folder = Path(item).expanduser()
    if "=" in item and not folder.exists():
        return [item]
    files = expand_path(item)
    cameras = folders_with_images(folder)
    # Folders next to `images`, as omnisight simulate writes them, have the truth of each image.
    with_truth = {found.parent for found in cameras if found.name == IMAGES}
    cameras = [found for found in cameras if found.name == IMAGES or found.parent not in with_truth]
    if not cameras and folder.is_dir():
        cameras = sorted(filter(has_clip_suffix, files), key=natural_sort_key)
    if not cameras and folder.is_dir():
        cameras = _patterns_of([file for file in files if file.suffix.lower() in IMAGE_SUFFIXES])
    return [str(camera) for camera in cameras] if len(cameras) > 1 else [item]


def _patterns_of(files: Sequence[Path]) -> list[Path]:
    """Return the patterns that divide the images of a folder by camera; none if there is no or no unique way.

    Most numbers of the images of the first camera must be those of images of each other. There are fewer cameras than
    numbers.
    """
    ways = [way for way in patterns_by_name([file.name for file in files]) if _have_common_numbers(files, way)]
    by_camera = [way for way in ways if len(set(way)) ** 2 < len(way)]
    if len(by_camera) != 1:
        return []
    folder = Path(glob.escape(str(files[0].parent)))
    return [folder / pattern for pattern in sorted(set(by_camera[0]), key=natural_sort_key)]


def _have_common_numbers(files: Sequence[Path], patterns: Sequence[str]) -> bool:
    """Return whether images that match different patterns mostly have the same numbers."""
    numbers: dict[str, set[str]] = {}
    for file, pattern in zip(files, patterns, strict=True):
        before, _, after = pattern.partition("*")
        numbers.setdefault(pattern, set()).add(file.name[len(before) : len(file.name) - len(after)])
    first, *others = numbers.values()
    return all(2 * len(first & other) > len(first) for other in others)


def _distinct(cameras: Sequence[tuple[tuple[str, ...], str]]) -> dict[str, Any]:
    """Return the sources by the first of their possible names in which they all differ."""
    for depth in range(max(len(names) for names, _ in cameras)):
        named = {names[min(depth, len(names) - 1)]: source for names, source in cameras}
        if len(named) == len(cameras):
            return named
    names = [names[0] for names, _ in cameras]
    repeated = next(name for i, name in enumerate(names) if name in names[:i])
    raise ValueError(f"two cameras are named {repeated}: specify names, such as {repeated}2={cameras[-1][1]}")


def _named(item: str) -> tuple[tuple[str, ...], str]:
    """Return the possible names of a camera, the usual one first and then those of its folders, and its source."""
    name, is_named, source = item.partition("=")
    if is_named and re.fullmatch(r"[\w.-]+", name) and not Path(item).exists():
        return (name,), source
    path = Path(item)
    folders = tuple(folder.name for folder in path.absolute().parents if folder.name)
    if any(character in path.name for character in "*?["):
        fixed = re.sub(r"[*?]|\[[^]]*\]", "", path.stem).strip("_-. ")
        return ((fixed,) if fixed else ()) + folders, item
    return ((path.resolve().name if path.is_dir() else path.stem) or item, *folders), item


def with_common_frames(sources: Mapping[str, Any], options: CalibrateRigOptions, progress: Progress) -> dict[str, Any]:
    """Return the sources with clips replaced by image files of the same frames of every clip.

    Of each clip the most informative frames are selected; the frames that are selected in any are used of all: those of
    the same number, or the nearest in time if times are given.

    Raises
    ------
    ValueError
        If a clip or the file of times cannot be read.
    """
    clips = {name: Path(source) for name, source in sources.items() if _is_clip(source)}
    if not clips:
        return dict(sources)
    selected = {name: set[int]() for name in clips}
    for name, clip in clips.items():
        for target in options.targets.values():
            found = select_frames(
                clip,
                options.single(target).board,
                apply_exif=options.apply_exif,
                cache=options.cache,
                progress=lambda done, total, name=name: progress(f"read {name}", done, total),
            )
            selected[name] |= {int(path.stem.rpartition("-")[2]) for path in found.paths} if found.found else set()
    if options.times is None:
        common = dict.fromkeys(clips, set[int]().union(*selected.values()))
    else:
        times = read_times(options.times)
        common = _simultaneous_frames(selected, {name: frame_times(times.get(name, {})) for name in clips})
    frames = {name: list(write_frames(clip, sorted(common[name]), options.apply_exif)) for name, clip in clips.items()}
    return {name: frames.get(name, source) for name, source in sources.items()}


def _simultaneous_frames(
    selected: Mapping[str, set[int]], times: Mapping[str, Mapping[int, float]]
) -> dict[str, set[int]]:
    """Return the frames of each clip that are simultaneous with selected frames of any clip, and those selected."""
    moments = [times[name][k] for name, frames in selected.items() for k in frames if k in times[name]]
    found = {name: set(frames) for name, frames in selected.items()}
    for name, own in times.items():
        if not own:
            continue
        numbers, seconds = list(own), np.array(list(own.values()))
        limit = MAX_INTERVAL_SHARE * median_interval(seconds)
        for moment in moments:
            nearest = int(np.abs(seconds - moment).argmin())
            if abs(seconds[nearest] - moment) <= limit:
                found[name].add(numbers[nearest])
    return found


def _is_clip(source: Any) -> bool:
    return isinstance(source, str | PathLike) and has_clip_suffix(source)
