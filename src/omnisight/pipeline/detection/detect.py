"""Detection of a calibration board in images and video clips, and loading of observations: `omnisight detect`."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from omnisight.calibration.warm_up import start_warm_up
from omnisight.choices import check_options
from omnisight.corners import read_corners
from omnisight.images import IMAGE_SUFFIXES, UnreadableImage, collect_images, has_clip_suffix, reason_without_name
from omnisight.images.collect import expand_path
from omnisight.images.output_paths import image_labels
from omnisight.pipeline.detection.detect_options import DetectOptions, SourceOptions
from omnisight.progress import Progress, no_progress
from omnisight.targets import Detections, ImageDetection, detect_boards
from omnisight.targets.observations import Observations

Source = Observations | Detections | str | PathLike[str] | Sequence[Any]


def detect(
    source: str | PathLike[str] | Sequence[str | PathLike[str]],
    options: DetectOptions = DetectOptions(),
    *,
    progress: Progress = no_progress,
) -> Detections:
    """Detect a calibration board in images and in the most informative frames of video clips.

    Parameters
    ----------
    source
        A folder, an image, a clip, a glob pattern such as 'left*.jpg', or a list of them.
    options
        The board, and how images are read.
    progress
        Called with (stage, done, total).

    Raises
    ------
    ValueError
        If the source contains no images, or the board cannot be read.
    """
    check_options(options, DetectOptions)
    board = options.board
    images: list[Path] = []
    remarks: dict[Path, str] = {}
    unreadable: list[ImageDetection] = []
    for path in collect_images(_paths(source), videos=True):
        if not has_clip_suffix(path):
            images.append(path)
            continue
        from omnisight.calibration.frame_selection import select_frames  # imported on use: it compiles

        reading = partial(progress, f"read {path.name}")
        try:
            frames = select_frames(path, board, apply_exif=options.apply_exif, cache=options.cache, progress=reading)
        except UnreadableImage as error:
            unreadable.append(ImageDetection(path, note=reason_without_name(error, path)))
        else:
            images += frames.paths
            remarks[frames.paths[0]] = frames.note
    detections = detect_boards(
        images,
        board,
        square=options.square_m,
        apply_exif=options.apply_exif,
        cache=options.cache,
        progress=partial(progress, "detect boards"),
    )
    results = [
        image.with_remark(remarks[image.path]) if image.path in remarks else image for image in detections.images
    ]
    return replace(detections, images=results + unreadable)


def load_observations(
    source: Source, options: SourceOptions = SourceOptions(), *, progress: Progress = no_progress
) -> Observations:
    """Load the observations of a calibration: detect boards, read corner files, or take arrays.

    Parameters
    ----------
    source
        What `detect` takes; corner files of other programs; `Detections`; a list with one (board points, pixels) or
        (board points, pixels, covariance) per image, which needs the option `image_size`; or `Observations`.
    options
        The board, and how images or corner files are read.
    progress
        Called with (stage, done, total).

    Raises
    ------
    ValueError
        If the source is of another type, contains nothing, or cannot be read.
    """
    if isinstance(source, Observations):
        return source
    if isinstance(source, Detections):
        return Observations.from_detections(source, image_labels([image.path for image in source.images]))
    if (views := _list_of_arrays(source)) is not None:
        return _from_views(views, options)
    paths = _paths(source)
    if is_corner_source(paths):
        detections = read_corners(
            source_paths(paths), board=options.board, square=options.square_m, size=options.size, which=options.which
        )
    else:
        if options.image_size is not None:
            raise ValueError("--image-size is for corner files; images contain their size: leave it out")
        if options.which is not None:
            raise ValueError("--which is for corner files of several cameras: leave it out")
        start_warm_up()
        detections = detect(paths, options, progress=progress)
    return load_observations(detections)


def image_names(source: Source, options: SourceOptions = SourceOptions()) -> list[str]:
    """Return the names of the images that `load_observations` takes, without detecting boards.

    Raises
    ------
    ValueError
        If a corner file cannot be read.
    """
    is_loaded = isinstance(source, Observations | Detections) or _list_of_arrays(source) is not None
    if is_loaded or is_corner_source(_paths(source)):
        observations = load_observations(source, options)
        return list(observations.image_names or observations.names)
    return image_labels(collect_images(_paths(source), videos=True))


def is_corner_source(items: Iterable[str | PathLike[str]]) -> bool:
    """Return whether a source consists of corner files: it contains no image, clip or folder.

    Raises
    ------
    MissingFileError
        If a file does not exist.
    """
    items = [Path(item) for item in items]
    files = [path for item in items for path in expand_path(item)]
    has_images = any(path.suffix.lower() in IMAGE_SUFFIXES or has_clip_suffix(path) for path in files)
    return bool(files) and not has_images and not any(item.expanduser().is_dir() for item in items)


def source_paths(source: Sequence[str | PathLike[str]]) -> list[Path]:
    """Return the files that a source consists of."""
    if is_corner_source(source):
        return list(dict.fromkeys(path for item in source for path in expand_path(str(item))))
    return collect_images([str(item) for item in source], videos=True)


def _paths(source: Any) -> list[str]:
    """Return the items of a source of files."""
    items = [source] if isinstance(source, str | PathLike) else source
    if not isinstance(items, Sequence) or not all(isinstance(item, str | PathLike) for item in items):
        raise ValueError(
            "source must be a folder, image files, a clip, corner files, a list of (board points, pixels) arrays,"
            f" Detections or Observations, got {type(source).__name__}"
        )
    if not items:
        raise ValueError("source is empty: specify a folder, image files, clips or corner files")
    return [str(item) for item in items]


def _list_of_arrays(source: Any) -> list[Sequence[Any]] | None:
    """Return the views of a source that is a list of tuples of arrays, or None."""
    if isinstance(source, str | PathLike) or not isinstance(source, Sequence) or not source:
        return None
    views = list(source)
    is_arrays = all(isinstance(view, Sequence) and not isinstance(view, str) and len(view) in (2, 3) for view in views)
    return views if is_arrays else None


def _from_views(views: Sequence[Sequence[Any]], options: SourceOptions) -> Observations:
    """Join one (board points, pixels[, covariance]) per image."""
    size = options.size
    if size is None:
        raise ValueError(
            'arrays do not contain the image size: specify image_size="1280x720", or use'
            " Observations.from_arrays(board_points, pixels, size=(width, height))"
        )
    counts = {len(view) for view in views}
    if len(counts) > 1:
        raise ValueError("specify a covariance for every image or for none")
    board_points, pixels, *covariance = zip(*views, strict=True)
    square = options.square_m
    scale = 1.0 if square is None else square
    points = [np.asarray(x, float) * scale for x in board_points]
    unit = "squares" if square is None else "m"
    return Observations.from_arrays(points, pixels, covariance[0] if covariance else None, size=size, unit=unit)
