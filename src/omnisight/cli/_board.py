"""The board that a command is told about, and the search for it."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from omnisight.cli._progress import Report
from omnisight.targets import Board, Checkerboard, Detections, parse_length
from omnisight.targets.target_file import load_board


def asked_board(pattern: str | None, square: str | None, target: Path | None) -> Board | None:
    """Give the board of --pattern and --square, or of --target; None if nothing but a square was told.

    Raises
    ------
    ValueError
        If one cannot be read, or both were given.
    """
    if target is not None:
        if pattern is not None or square is not None:
            raise ValueError("give --target, or --pattern and --square, not both: the file says it all")
        return load_board(target)
    if square is not None:
        parse_length(square)
    return None if pattern is None else Checkerboard.parse(pattern, square=square)


def search_boards(
    paths: Sequence[Path], board: Board | None, square: str | None, report: Report, *, apply_exif: bool, cache: bool
) -> Detections:
    """Find a board in images and in the frames of clips that say most, with progress.

    `square` is that of a board yet unknown. A clip that gives no frames stays as an image that cannot be read.
    """
    from omnisight.calibration.frame_selection import choose_frames
    from omnisight.images import VIDEO_EXTENSIONS, UnreadableImage
    from omnisight.targets import ImageDetection, detect_boards

    shots: list[Path] = []
    remarks: dict[Path, str] = {}
    lost: list[ImageDetection] = []
    for path in paths:
        if path.suffix.lower() not in VIDEO_EXTENSIONS:
            shots.append(path)
            continue
        looking = partial(report, f"look through {path.name}")
        try:
            chosen = choose_frames(path, board, apply_exif=apply_exif, cache=cache, progress=looking)
        except UnreadableImage as error:
            lost.append(ImageDetection(path, note=str(error)))
        else:
            shots += chosen.paths
            remarks[chosen.paths[0]] = chosen.note
    search = detect_boards(
        shots,
        board,
        square=None if square is None else parse_length(square),
        apply_exif=apply_exif,
        cache=cache,
        progress=lambda done, all_: report("find boards", done, all_),
    )
    pictures = [p.with_remark(remarks[p.path]) if p.path in remarks else p for p in search.images]
    return replace(search, images=pictures + lost)
