"""Inputs of `omnisight reconstruct` and `omnisight map`."""

import sys
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from omnisight.pipeline.options import ReconstructOptions

if TYPE_CHECKING:
    from omnisight.pipeline.work_folder import WorkFolder

# Sub-folder of the output with what an interrupted run has computed.
WORK = "work"


@contextmanager
def continuing(work: "WorkFolder") -> Generator[None]:
    """State after Ctrl-C how to continue."""
    try:
        yield
    except KeyboardInterrupt:
        if work.folder is not None and work.folder.is_dir():
            print(f"the same command continues from {work.folder}; delete it to start anew", file=sys.stderr)
        raise


def parse_cameras(values: list[str]) -> str | dict[str, str] | None:
    """Return the file of the only camera, or those of several by name."""
    if len(values) <= 1 and not any("=" in value for value in values):
        return values[0] if values else None
    pairs = [value.partition("=") for value in values]
    if unnamed := [value for value, sign, _ in pairs if not sign]:
        raise ValueError(f"--camera {unnamed[0]}: several cameras need names, such as --camera front={unnamed[0]}")
    return {name: file for name, _, file in pairs}


def folder_of_images(
    images: Path, output: Path, options: ReconstructOptions, *, has_rig: bool
) -> tuple[Path, bool, ReconstructOptions]:
    """Return the folder or file of the images, whether they are extracted from a clip or bag, and the options."""
    from omnisight.images.ros_bag import is_bag
    from omnisight.images.video import is_clip as is_video_clip

    has_topic = is_bag(images, options.topic)
    is_clip = has_topic or is_video_clip(images)
    if has_topic and has_rig:
        raise ValueError(f"{images}: a topic has the images of one camera: extract those of a rig to folders")
    if is_clip and options.pairs == "auto":
        options = replace(options, pairs="sequential")
    return (output / "images" if is_clip else images), is_clip, options
