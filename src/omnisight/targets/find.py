"""Finds a board in many pictures: skips what cannot be read, says why, and remembers what it found."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.images import UnreadableImage, decode_image, exif_orientation, read_bytes, to_gray8

from .board import Board
from .cache import cache_key, load_entry, save_entry
from .checkerboard import DETECTOR_VERSION, search_checkerboard
from .detection import Detection


@dataclass(frozen=True)
class PictureDetection:
    """What one picture file gave.

    Attributes
    ----------
    path : Path
    size : (int, int) or None
        Width and height in pixels; None if the file could not be read.
    detection : Detection or None
    note : str
        Why there is no detection, or what else the user should know; may be empty.
    sharpness : float
        Laplacian energy over contrast energy on the board (on the picture where there is none): higher is
        sharper, to be compared within one set; NaN if the file could not be read.
    other_pattern : (int, int) or None
        Columns and rows of another checkerboard that was seen instead.
    """

    path: Path
    size: tuple[int, int] | None = None
    detection: Detection | None = None
    note: str = ""
    sharpness: float = float("nan")
    other_pattern: tuple[int, int] | None = None


def find_boards(
    paths: Iterable[str | Path],
    board: Board,
    *,
    apply_exif: bool = False,
    cache: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> list[PictureDetection]:
    """Find a board in each picture.

    Parameters
    ----------
    paths : iterable of str or Path
    board : Board
    apply_exif : bool
        Turn pictures upright by their EXIF orientation first.
    cache : bool
        Take detections from earlier runs, and keep these for later ones.
    progress : callable, optional
        Called with (pictures done, pictures in all) after each.

    Returns
    -------
    list of PictureDetection
        One for each path, in the order given.

    Raises
    ------
    ValueError
        If the pictures differ in size.
    """
    paths = [Path(path) for path in paths]
    pictures: list[PictureDetection] = []
    with ThreadPoolExecutor(max_workers=min(8, os.cpu_count() or 1)) as pool:
        results = pool.map(lambda path: _find(path, board, apply_exif, cache), paths)
        turned_before = False
        for picture, orientation in results:
            turned = orientation != 1 and not apply_exif
            if turned and not turned_before:
                picture = replace(picture, note=_joined(picture.note, _exif_note(orientation)))
            turned_before |= turned
            pictures.append(picture)
            if progress is not None:
                progress(len(pictures), len(paths))
    check_sizes(pictures)
    return pictures


def check_sizes(pictures: Iterable[PictureDetection]) -> None:
    """Raise ValueError, with the counts, if pictures differ in size."""
    by_size: dict[tuple[int, int], list[str]] = {}
    for picture in pictures:
        if picture.size is not None:
            by_size.setdefault(picture.size, []).append(picture.path.name)
    if len(by_size) < 2:
        return
    ordered = sorted(by_size.items(), key=lambda item: -len(item[1]))
    (width, height), _ = ordered[0]
    parts: list[str] = []
    for size, names in ordered:
        part = f"{len(names)} of {size[0]}x{size[1]}"
        if size != (width, height):
            part += f" ({', '.join(names[:3])}{', ...' if len(names) > 3 else ''})"
        if size == (height, width) != (width, height):
            part += ", rotated 90 degrees?"
        parts.append(part)
    raise ValueError(f"pictures have {len(by_size)} sizes: {'; '.join(parts)}. Calibrate one size at a time.")


def pattern_hint(pictures: Iterable[PictureDetection], board: Board) -> str | None:
    """Say that pictures show another board than the given one, if more of them do than not."""
    pictures = [picture for picture in pictures if picture.size is not None]
    others = Counter(p.other_pattern for p in pictures if p.other_pattern is not None)
    found = sum(picture.detection is not None for picture in pictures)
    if not others:
        return None
    (columns, rows), count = others.most_common(1)[0]
    if count <= found:
        return None
    squares = sorted((board.columns - 1, board.rows - 1)) == sorted((columns, rows))
    reason = f"{board} squares have {columns}x{rows} inner corners" if squares else "did you count squares?"
    return (
        f"found a {columns}x{rows} grid of inner corners in {count}/{len(pictures)} pictures "
        f"but --pattern is {board} ({reason}). Use --pattern {columns}x{rows}."
    )


def _find(path: Path, board: Board, apply_exif: bool, cache: bool) -> tuple[PictureDetection, int]:
    try:
        data = read_bytes(path)
        orientation = exif_orientation(data)
        key = cache_key(data, board.columns, board.rows, apply_exif, DETECTOR_VERSION)
        entry = load_entry(key) if cache else None
        picture = None if entry is None else _from_entry(path, entry, board)
        if picture is None:
            gray = to_gray8(decode_image(data, path.name, apply_exif=apply_exif))
            picture = _search(path, gray, board)
            if cache:
                save_entry(key, _to_entry(picture))
    except UnreadableImage as error:
        return PictureDetection(path, note=str(error)), 1
    if picture.detection is None:
        picture = replace(picture, note=_missing_note(board, picture.other_pattern))
    elif len(picture.detection) < board.size:
        picture = replace(picture, note=f"{len(picture.detection)} of {board.size} corners")
    return picture, orientation


def _search(path: Path, gray: NDArray[np.uint8], board: Board) -> PictureDetection:
    detection, other = search_checkerboard(gray, board)
    size = (gray.shape[1], gray.shape[0])
    return PictureDetection(path, size, detection, "", _sharpness(gray, detection), other)


def _sharpness(gray: NDArray[np.uint8], detection: Detection | None) -> float:
    import cv2

    if detection is not None:
        (left, top), (right, bottom) = detection.pixels.min(axis=0), detection.pixels.max(axis=0)
        gray = gray[max(int(top), 0) : int(bottom) + 2, max(int(left), 0) : int(right) + 2]
    return float(cv2.Laplacian(gray, cv2.CV_32F).var() / max(float(gray.var()), 1.0))


def _missing_note(board: Board, other: tuple[int, int] | None) -> str:
    return f"no {board} board found" + ("" if other is None else f", but one of {other[0]}x{other[1]}")


def _exif_note(orientation: int) -> str:
    return f"EXIF orientation {orientation} ignored, here and in the other pictures: the sensor does not turn"


def _joined(*notes: str) -> str:
    return "; ".join(note for note in notes if note)


def _to_entry(picture: PictureDetection) -> dict[str, Any]:
    detection = picture.detection
    return {
        "size": picture.size,
        "ids": None if detection is None else detection.ids.tolist(),
        "pixels": None if detection is None else detection.pixels.tolist(),
        "sharpness": picture.sharpness,
        "other_pattern": picture.other_pattern,
    }


def _from_entry(path: Path, entry: dict[str, Any], board: Board) -> PictureDetection | None:
    """Rebuild a picture's result; None if the entry is not what was written."""
    try:
        width, height = (int(length) for length in entry["size"])
        detection = None
        if entry["ids"] is not None:
            detection = Detection(np.array(entry["ids"], np.int64), np.array(entry["pixels"], np.float64))
            if not set(entry["ids"]) <= set(range(board.size)) or not np.isfinite(detection.pixels).all():
                return None
        other = entry["other_pattern"]
        other = None if other is None else (int(other[0]), int(other[1]))
        return PictureDetection(path, (width, height), detection, "", float(entry["sharpness"]), other)
    except (KeyError, IndexError, TypeError, ValueError):
        return None
