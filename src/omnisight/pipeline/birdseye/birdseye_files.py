"""Bird's-eye views of files: images, folders and clips, one output frame for each moment."""

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Any

from omnisight.formats import format_of_suffix, save
from omnisight.images import Clip, write_image
from omnisight.images.output_paths import check_folder_of, check_output_folder, refuse_overwrite
from omnisight.images.video_writer import VideoWriter
from omnisight.images.write import check_image_suffix
from omnisight.pipeline.birdseye.birdseye import (
    BirdseyeRenderer,
    BirdseyeResult,
    birdseye_result,
    check_sizes,
    load_body,
    prepare_birdseye,
)
from omnisight.pipeline.birdseye.birdseye_options import BirdseyeOptions
from omnisight.pipeline.inputs.image_set import image_folders
from omnisight.pipeline.inputs.images_of_cameras import FOLDER_FPS, frame_count, is_sequence, match_cameras, moments
from omnisight.progress import Progress, no_progress
from omnisight.video_options import VideoOptions


@dataclass(frozen=True, eq=False)
class BirdseyeFiles:
    """Views that were written.

    Attributes
    ----------
    result
        The view of the first moment.
    frames
        Number of views.
    files
        The files that were written: the image, the video or the folder, and the rig.
    seconds
        Time of the whole computation.
    """

    result: BirdseyeResult = field(repr=False)
    frames: int
    files: tuple[Path, ...]
    seconds: float


def write_birdseye(
    sources: Sequence[Path],
    rig: Path | Mapping[str, Path],
    output: Path,
    options: BirdseyeOptions = BirdseyeOptions(),
    *,
    video: VideoOptions = VideoOptions(),
    save_rig: Path | None = None,
    progress: Progress = no_progress,
) -> BirdseyeFiles:
    """Compute the bird's-eye views of images, folders or clips of a rig, and write them.

    Parameters
    ----------
    sources
        One image, folder or clip for each camera, with its name in the path.
    rig
        File of the rig, or of its only camera; or the files of its cameras by name.
    output
        Image to write; for clips and folders a video or a folder.
    options
        Options of the view. The first moment determines the ground.
    video
        Codec and quality of a video; the sound is that of the clip of the first camera.
    save_rig
        File of the rig in the ground frame to write.
    progress
        Called with a stage, the frames done and their number; 0 if it is unknown.

    Raises
    ------
    ValueError
        If the sources are not those of the cameras, or `birdseye` raises it.
    """
    start = time.perf_counter()
    body = load_body(rig, options)
    body_files = rig.values() if isinstance(rig, Mapping) else [rig]
    ordered = match_cameras(sources, body.names)
    _check_output(ordered, output, save_rig, video, [*body_files, *_option_files(options)])
    total, count = frame_count(ordered), 0
    result: BirdseyeResult | None = None
    renderer: BirdseyeRenderer | None = None
    with ExitStack() as stack:
        write = None
        for images, seconds in moments(ordered, options.apply_exif):
            began = time.perf_counter()
            if renderer is None:
                renderer = prepare_birdseye(images, body, options)
                write = _writer(ordered, output, renderer, video, stack)
            check_sizes(images, renderer.calibration.rig)
            gains = renderer.gains(images)
            image = renderer.remapper(images, gains)
            if result is None:
                result = birdseye_result(image, renderer, images, gains, began)
            assert write is not None
            write(image, count, seconds)
            count += 1
            progress("bird's-eye view", count, max(total, count))
    if result is None:
        raise ValueError(f"{ordered[0]}: has no frames")
    files = [output]
    if save_rig is not None:
        save(replace(result.rig, provenance={**result.rig.provenance, "frame": "ground"}), save_rig)
        files.append(save_rig)
    return BirdseyeFiles(result, count, tuple(files), time.perf_counter() - start)


def _option_files(options: BirdseyeOptions) -> list[Path]:
    """Return the files that options name."""
    files = [options.ground, options.ground_board, options.target, Path(options.vehicle)]
    masks = options.masks.iterdir() if options.masks is not None and options.masks.is_dir() else ()
    return [*(file for file in files if file is not None), *masks]


def _check_output(
    sources: Sequence[Path], output: Path, save_rig: Path | None, video: VideoOptions, others: Sequence[Path]
) -> None:
    """Raise before any work if an output would replace an input or cannot be written."""
    several = any(is_sequence(source) for source in sources)
    if several and not _is_video(output):
        folders = [source for source in sources if source.is_dir()]
        check_output_folder(output, [*folders, *chain.from_iterable(map(image_folders, folders))])
    outputs = [path for path in (output, save_rig) if path is not None]
    refuse_overwrite(outputs, [*sources, *others])
    for path in outputs:
        check_folder_of(path)
    if several and _is_video(output):
        video.codec_of(output)
    if not several and is_sequence(output):
        raise ValueError(f"{output}: the view of one moment is an image; name a file, such as top.png")
    if not several:
        check_image_suffix(output)
    if save_rig is not None:
        format_of_suffix(save_rig)


def _is_video(output: Path) -> bool:
    """Return whether the views of several moments are written to a file rather than a folder."""
    return bool(output.suffix) and not output.is_dir()


def _writer(
    sources: Sequence[Path], output: Path, renderer: BirdseyeRenderer, video: VideoOptions, stack: ExitStack
) -> Callable[[Any, int, float], None]:
    """Return a function that writes a view with its number and time."""
    if not any(is_sequence(source) for source in sources):
        return lambda image, number, seconds: write_image(output, image)
    if _is_video(output):
        like = FOLDER_FPS if sources[0].is_dir() else Clip.open(sources[0])
        writer = stack.enter_context(VideoWriter(output, renderer.view.size, like, video))
        return lambda image, number, seconds: writer.write(image, seconds)
    output.mkdir(parents=True, exist_ok=True)
    return lambda image, number, seconds: write_image(output / f"{number:06d}.png", image)
