"""The images of each camera of a rig, by name."""

import re
from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

from omnisight.calibration.frame_selection import select_frames, write_frames
from omnisight.images import IMAGE_SUFFIXES, has_clip_suffix
from omnisight.pipeline.calibrate_rig_options import CalibrateRigOptions

Progress = Callable[[str, int, int], None]
RigSources = Mapping[str, Any]


def named_sources(sources: RigSources | Sequence[str | PathLike[str]]) -> dict[str, Any]:
    """Return the source of each camera by its name.

    The name is that of the folder or clip, the fixed part of a pattern such as 'left*.jpg', or NAME in NAME=SOURCE.

    Raises
    ------
    ValueError
        If there are fewer than two cameras, two have the same name, or one is a single image.
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
        pairs = [_named(item) for item in items]
        if repeated := [name for i, (name, _) in enumerate(pairs) if name in [n for n, _ in pairs[:i]]]:
            raise ValueError(f"two cameras are named {repeated[0]}: specify names, such as {repeated[0]}2={items[-1]}")
        named = dict(pairs)
    if len(named) < 2:
        raise ValueError(
            f"{len(named)} camera{'s' * (len(named) != 1)}, and a rig has at least two: specify a folder, a clip or a"
            " pattern for each, such as left/ right/ or 'left*.jpg' 'right*.jpg' (omnisight calibrate is for one)"
        )
    return named


def _named(item: str) -> tuple[str, str]:
    """Return the name of a camera and its source."""
    name, is_named, source = item.partition("=")
    if is_named and re.fullmatch(r"[\w.-]+", name) and not Path(item).exists():
        return name, source
    path = Path(item)
    if any(character in path.name for character in "*?["):
        fixed = re.sub(r"[*?]|\[[^]]*\]", "", path.stem).strip("_-. ")
        return fixed or path.parent.name or "camera", item
    return (path.resolve().name if path.is_dir() else path.stem) or item, item


def with_common_frames(sources: Mapping[str, Any], options: CalibrateRigOptions, progress: Progress) -> dict[str, Any]:
    """Return the sources with clips replaced by image files of the same frames of every clip.

    Of each clip the most informative frames are selected; the frames that are selected in any are used of all.

    Raises
    ------
    ValueError
        If a clip cannot be read.
    """
    clips = {name: Path(source) for name, source in sources.items() if _is_clip(source)}
    if not clips:
        return dict(sources)
    indices: set[int] = set()
    for name, clip in clips.items():
        for target in options.targets.values():
            found = select_frames(
                clip,
                options.single(target).board,
                apply_exif=options.apply_exif,
                cache=options.cache,
                progress=lambda done, total, name=name: progress(f"read {name}", done, total),
            )
            indices |= {int(path.stem.rpartition("-")[2]) for path in found.paths} if found.found else set()
    frames = {name: list(write_frames(clip, sorted(indices), options.apply_exif)) for name, clip in clips.items()}
    return {name: frames.get(name, source) for name, source in sources.items()}


def _is_clip(source: Any) -> bool:
    return isinstance(source, str | PathLike) and has_clip_suffix(source)
