"""Selection of the most informative frames of a video clip for calibration, written as image files."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from omnisight.cache import frames_folder, remove_least_recent, touch
from omnisight.calibration.frame_information import MAX_SELECTED, select_informative_views
from omnisight.images import MAX_FRAMES, Clip, write_image
from omnisight.progress import StageProgress, no_progress
from omnisight.targets import Board
from omnisight.targets.cache import cache_key, load_entry, save_entry
from omnisight.targets.clip_detection import ClipDetections, detect_in_clip
from omnisight.targets.observations import Observations
from omnisight.targets.raw_detections import DETECTOR_VERSION

# Version of cached selections.
SELECTION_VERSION = 2
# Frames that are returned if none shows the board: messages report what they show instead.
FRAMES_WITHOUT_BOARD = 3
# Frames per second below which the motion between two frames is not that during the exposure of one.
MIN_RATE_OF_MOTION = 10.0
# Clips whose frames are kept, and time without use, s, before which none are removed: a command can need them.
MAX_CLIPS, MIN_UNUSED_S = 32, 24 * 3600.0
# Characters of the clip's name in the names of frames.
MAX_STEM_LENGTH = 60


@dataclass(frozen=True)
class SelectedFrames:
    """The selected frames of a clip.

    Attributes
    ----------
    paths
        One lossless gray image each, named after the clip and the index of the frame.
    count, searched, found
        Number of frames in the clip, of those searched for a board, and of those with a board.
    note
        One line with these numbers, and what else the user should know.
    """

    paths: tuple[Path, ...]
    count: int
    searched: int
    found: int
    note: str


def select_frames(
    path: str | Path,
    board: Board | None = None,
    *,
    apply_exif: bool = False,
    cache: bool = True,
    progress: StageProgress = no_progress,
) -> SelectedFrames:
    """Select the most informative frames of a clip: sharp, without motion, and each with new information.

    They are written to the cache folder, by the content of the clip; every stage can read them as image files.

    Parameters
    ----------
    path
        A video file.
    board
        Without one, checkerboards are detected, of the size that most frames agree on.
    apply_exif
        Rotate frames as the file requests; a calibration needs them as the sensor recorded them.
    cache
        Reuse the selection of an earlier run, and store this one.
    progress
        Called with (frames done, number of frames).

    Raises
    ------
    UnreadableImage
        If the file contains no readable frames.
    OSError
        If the frames cannot be written.
    """
    clip = Clip.open(path, upright=apply_exif)
    digest = _digest(clip)
    key = cache_key(digest.encode(), "clip", board and board.to_dict(), apply_exif, DETECTOR_VERSION, SELECTION_VERSION)
    selection = _from_entry(load_entry(key)) if cache else None
    if selection is None:
        seen = detect_in_clip(clip, board, progress=progress)
        selection = _Selection(tuple(_select(seen, clip)), seen.count, len(seen.frames), len(seen.found))
        if cache:
            save_entry(key, vars(selection))
    return SelectedFrames(
        _written(clip, digest, selection.frames),
        selection.count,
        selection.searched,
        selection.found,
        _note(clip, selection),
    )


@dataclass(frozen=True)
class _Selection:
    frames: tuple[int, ...]
    count: int
    searched: int
    found: int


def _from_entry(entry: dict[str, Any] | None) -> _Selection | None:
    """Return the cached selection; None if the entry is invalid."""
    if entry is None:
        return None
    try:
        frames = tuple(map(int, entry["frames"]))
        counts = (int(entry[name]) for name in ("count", "searched", "found"))
        return _Selection(frames, *counts) if 0 < len(frames) <= MAX_SELECTED and min(frames) >= 0 else None
    except (KeyError, TypeError, ValueError, OverflowError):
        return None


def _select(seen: ClipDetections, clip: Clip) -> list[int]:
    if seen.board is None or not seen.found:
        others = [frame for frame in seen.frames if frame.has_grid] or list(seen.frames)
        return sorted(
            {others[i].index for i in np.linspace(0, len(others) - 1, FRAMES_WITHOUT_BOARD).round().astype(int)}
        )
    points = seen.board.points
    boards = [max(frame.boards, key=len) for frame in seen.found]
    arrays = zip(*((points[d.ids], d.pixels, d.covariance) for d in boards), strict=True)
    observations = Observations.from_arrays(*map(list, arrays), size=clip.size)
    motion = np.array([frame.motion for frame in seen.found])
    if clip.frame_rate < MIN_RATE_OF_MOTION:
        motion[:] = 0.0
    return sorted(seen.found[i].index for i in select_informative_views(observations, motion))


def write_frames(path: str | Path, indices: Sequence[int], apply_exif: bool = False) -> tuple[Path, ...]:
    """Return image files of frames of a clip, written to the cache folder if they do not exist yet.

    Frames that the clip does not have are left out.

    Raises
    ------
    UnreadableImage
        If the file contains no readable frames.
    OSError
        If the frames cannot be written.
    """
    clip = Clip.open(path, upright=apply_exif)
    return tuple(file for file in _written(clip, _digest(clip), tuple(indices)) if file.is_file())


def _digest(clip: Clip) -> str:
    with clip.path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _written(clip: Clip, digest: str, indices: tuple[int, ...]) -> tuple[Path, ...]:
    """Return image files of the frames, written if they do not exist yet."""
    stem = clip.path.stem[:MAX_STEM_LENGTH]
    clips = frames_folder()
    folder = clips / f"{digest[:16]}{'-upright' * clip.upright}"
    paths = {index: folder / f"{stem}-{index:06d}.png" for index in indices}
    missing = {index for index, path in paths.items() if not path.is_file()}
    if missing:
        folder.mkdir(parents=True, exist_ok=True)
        for frame in clip.frames(missing):
            write_image(paths[frame.index], frame.gray)
        remove_least_recent(clips.iterdir(), MAX_CLIPS, MIN_UNUSED_S)
    touch(folder)
    return tuple(paths.values())


def _note(clip: Clip, selection: _Selection) -> str:
    parts = [
        f"{clip.path.name}: {selection.count} frames, {selection.searched} searched, {selection.found} with a board,"
        f" {len(selection.frames) if selection.found else 0} selected"
    ]
    if selection.count >= MAX_FRAMES:
        parts.append(f"frames after the first {MAX_FRAMES} not read")
    elif truncation := clip.truncation(selection.count):
        parts.append(truncation.removeprefix(f"{clip.path.name}: "))
    if clip.rotation_deg and not clip.upright:
        parts.append(f"rotation of {clip.rotation_deg}° ignored: a calibration needs frames as recorded")
    return "; ".join(parts)
