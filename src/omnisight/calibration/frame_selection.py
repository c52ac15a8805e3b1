"""From a clip to the few of its frames that a calibration learns most from, as image files."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from omnisight.cache import cache_folder
from omnisight.calibration.frame_information import MOST, select_informative_frames
from omnisight.images import MAX_FRAMES, Clip, write_image
from omnisight.targets import Board
from omnisight.targets.cache import cache_key, load_entry, save_entry
from omnisight.targets.clip_detection import ClipDetections, detect_in_clip
from omnisight.targets.observations import Observations
from omnisight.targets.raw_detections import DETECTOR_VERSION

CHOICE_VERSION = 1
# Frames that are given where none shows the board, so that the answer can say what they show instead.
FEW = 3
# Share of the declared frames below which a clip counts as cut short; many declare a few too many.
WHOLE = 0.95


@dataclass(frozen=True)
class ChosenFrames:
    """The frames of a clip that a calibration is to use.

    Attributes
    ----------
    paths
        One image each, named after the clip and the frame's index; gray, without loss.
    count, looked, found
        Frames in the clip, those at which a board was looked for, and those that show it.
    note
        One line that says so, and what else the user should know.
    """

    paths: tuple[Path, ...]
    count: int
    looked: int
    found: int
    note: str


def choose_frames(
    path: str | Path,
    board: Board | None = None,
    *,
    apply_exif: bool = False,
    cache: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> ChosenFrames:
    """Choose the frames of a clip that say most about the camera: sharp, still, and each something new.

    They are written to the cache folder, by the clip's content, so that all that takes image files takes them.

    Parameters
    ----------
    path
        A video file.
    board
        Without one a checkerboard is looked for, of the size that most frames agree on.
    apply_exif
        Turn frames as the file asks; a calibration needs them as the sensor read them.
    cache
        Take the choice from an earlier run, and keep this one for later ones.
    progress
        Called with (frames done, frames in all).

    Raises
    ------
    UnreadableImage
        If the file gives no frames.
    OSError
        If the frames cannot be written.
    """
    clip = Clip.open(path, upright=apply_exif)
    with clip.path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    key = cache_key(digest.encode(), "clip", board and board.to_dict(), apply_exif, DETECTOR_VERSION, CHOICE_VERSION)
    choice = _from_entry(load_entry(key)) if cache else None
    if choice is None:
        seen = detect_in_clip(clip, board, progress=progress)
        choice = _Choice(tuple(_chosen(seen, clip.size)), seen.count, len(seen.frames), len(seen.found))
        if cache:
            save_entry(key, vars(choice))
    return ChosenFrames(
        _written(clip, digest, choice.frames), choice.count, choice.looked, choice.found, _note(clip, choice)
    )


@dataclass(frozen=True)
class _Choice:
    frames: tuple[int, ...]
    count: int
    looked: int
    found: int


def _from_entry(entry: dict[str, Any] | None) -> _Choice | None:
    """Rebuild it; None if the entry is not what was written."""
    if entry is None:
        return None
    try:
        frames = tuple(map(int, entry["frames"]))
        counts = (int(entry[name]) for name in ("count", "looked", "found"))
        return _Choice(frames, *counts) if 0 < len(frames) <= MOST and min(frames) >= 0 else None
    except (KeyError, TypeError, ValueError, OverflowError):
        return None


def _chosen(seen: ClipDetections, size: tuple[int, int]) -> list[int]:
    if seen.board is None or not seen.found:
        others = [frame for frame in seen.frames if frame.has_grid] or list(seen.frames)
        return sorted({others[i].index for i in np.linspace(0, len(others) - 1, FEW).round().astype(int)})
    points = seen.board.points
    boards = [max(frame.boards, key=len) for frame in seen.found]
    views = Observations.of([(points[d.ids], d.pixels, d.covariance) for d in boards])
    motion = np.array([frame.motion for frame in seen.found])
    return sorted(seen.found[i].index for i in select_informative_frames(views, size, motion))


def _written(clip: Clip, digest: str, indices: tuple[int, ...]) -> tuple[Path, ...]:
    """Give image files of frames, those that are not there yet written."""
    stem = clip.path.stem[:60]
    folder = cache_folder() / "frames" / f"{digest[:16]}{'-upright' * clip.upright}"
    paths = {index: folder / f"{stem}-{index:06d}.png" for index in indices}
    missing = {index for index, path in paths.items() if not path.is_file()}
    if missing:
        folder.mkdir(parents=True, exist_ok=True)
        for frame in clip.frames(missing):
            write_image(paths[frame.index], frame.gray)
    return tuple(paths.values())


def _note(clip: Clip, choice: _Choice) -> str:
    said = [
        f"{clip.path.name}: {choice.count} frames, {choice.looked} looked at, {choice.found} with a board,"
        f" {len(choice.frames) if choice.found else 0} chosen"
    ]
    declared = clip.declared_frames or 0
    if choice.count >= MAX_FRAMES:
        said.append(f"frames after the first {MAX_FRAMES} not read")
    elif choice.count < WHOLE * declared:
        said.append(f"ends after {choice.count} of {declared} frames: was the copy cut short?")
    if clip.rotation_deg and not clip.upright:
        said.append(f"rotation of {clip.rotation_deg} degrees ignored: the sensor does not turn")
    return "; ".join(said)
