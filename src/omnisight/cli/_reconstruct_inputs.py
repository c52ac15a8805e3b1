"""Inputs of `omnisight reconstruct` and `omnisight map`."""

import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from omnisight.cli._output import warn
from omnisight.cli._progress import progress
from omnisight.pipeline.reconstruction.reconstruct_options import ReconstructOptions

Result = TypeVar("Result")

# Sub-folder of the output with what an interrupted run has computed.
WORK = "work"


@contextmanager
def _continuing(work: Path) -> Generator[None]:
    """State after Ctrl-C how to continue."""
    try:
        yield
    except KeyboardInterrupt:
        if work.is_dir():
            print(f"the same command continues from {work}; delete it to start anew", file=sys.stderr)
        raise


def parse_cameras(values: list[str]) -> str | dict[str, str] | None:
    """Return the file of the only camera, or those of several by name."""
    if len(values) <= 1 and not any("=" in value for value in values):
        return values[0] if values else None
    pairs = [value.partition("=") for value in values]
    if unnamed := [value for value, sign, _ in pairs if not sign]:
        raise ValueError(f"--camera {unnamed[0]}: several cameras need names, such as --camera front={unnamed[0]}")
    return {name: file for name, _, file in pairs}


def run_on_images(
    function: Callable[..., Result],
    images: Path,
    camera: list[str] | None,
    rig: Path | None,
    output: Path,
    options: ReconstructOptions,
) -> tuple[Result, Path]:
    """Call a function of the library with the images of a folder, a clip or a bag, and a work folder in the output.

    Frames of a clip or a bag are written to a folder in the output; by default each is matched with the next ones.

    Returns
    -------
    result
        The result of the function.
    folder
        The folder of the images.
    """
    from omnisight.compilation import compile_in_parallel
    from omnisight.images.collect import folders_with_images
    from omnisight.images.output_paths import check_output_folder
    from omnisight.images.ros_bag import is_bag
    from omnisight.images.video import is_clip
    from omnisight.pipeline.reconstruction.clip_frames import extract_frames
    from omnisight.reconstructions import refuse_other_files
    from omnisight.twoview.first_run import parts

    check_output_folder(output, [images, *(folders_with_images(images) if images.is_dir() else ())])
    if not (output / WORK).is_dir():  # an interrupted run may have written some of its files
        for folder in (output, *(each for each in output.glob("[0-9]*") if each.name.isdecimal())):
            refuse_other_files(folder)
    has_topic = is_bag(images, options.topic)
    if has_topic and rig is not None:
        raise ValueError(f"{images}: a topic has the images of one camera: extract those of a rig to folders")
    files, folder, cameras = images, images if images.is_dir() else images.parent, parse_cameras(camera or [])
    with _continuing(output / WORK), progress() as report, compile_in_parallel(parts):
        if has_topic or is_clip(images):
            folder = output / "images"
            topic, apply_exif = options.topic, options.apply_exif
            files = extract_frames(images, folder, options.fps, report, topic=topic, apply_exif=apply_exif, warn=warn)
            options = replace(options, pairs="sequential") if options.pairs == "auto" else options
        return function(files, cameras, rig, options, report, output / WORK), folder
