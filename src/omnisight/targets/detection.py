"""Detect a board in a set of images: determine which board it is, and explain every image without one."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.images import UnreadableImage, reason_without_name
from omnisight.progress import StageProgress, no_progress
from omnisight.targets.boards import Board
from omnisight.targets.boards.checkerboard import Checkerboard, squares_text
from omnisight.targets.detections import Detection, Detections, ImageDetection, boards_note
from omnisight.targets.detectors import detect
from omnisight.targets.detectors.checkerboard.board_assignment import (
    MIN_FILLED_SHARE,
    assign_to_board,
    most_common_pattern,
)
from omnisight.targets.detectors.checkerboard.corner_grid import CornerGrid
from omnisight.targets.drawn_corners import leave_out_drawn_corners
from omnisight.targets.image_files import BoardImages, ImageFiles
from omnisight.targets.image_sizes import most_common_size, size_mismatch_note, sizes_note
from omnisight.targets.raw_detections import RawDetections
from omnisight.targets.set_checks import mirrored_markers_note, with_duplicate_remarks, with_field_remark
from omnisight.targets.set_field import estimate_set_field
from omnisight.targets.undistorted_copies import leave_out_undistorted_copies
from omnisight.targets.unspecified_board import recognize_board

Pattern = tuple[int, int]


def detect_boards(
    paths: Iterable[str | Path],
    board: Board | None = None,
    *,
    square: float | None = None,
    apply_exif: bool = False,
    cache: bool = True,
    progress: StageProgress = no_progress,
) -> Detections:
    """Detect a board in image files.

    Images whose size differs from that of most images with a board are left out, with a note: they are from another
    camera.

    Parameters
    ----------
    paths : iterable of str or Path
    board : Board, optional
        Without one, checkerboards are detected, of the size that most images agree on; or else a board with markers or
        circles is recognized, and `assumption` of the result states what was assumed of it.
    square : float, optional
        Side in metres of such a board's squares or markers, or the spacing of its circles.
    apply_exif : bool
        Rotate images by their EXIF orientation first.
    cache : bool
        Use detections from earlier runs, and store these for later ones.
    progress : callable, optional
        Called with (images done, number of images) after each.
    """
    return detect_in_set(ImageFiles([Path(path) for path in paths], apply_exif, cache, progress), board, square)


def detect_in_set(files: BoardImages, board: Board | None, square: float | None) -> Detections:
    """Detect a board in images, wherever they are; see `detect_boards`."""
    paths, results = files.paths, files.detect(board)
    readable = [(path, raw) for path, raw in zip(paths, results, strict=True) if isinstance(raw, RawDetections)]
    size = most_common_size([(raw.size, bool(raw.grids or raw.boards)) for _, raw in readable])
    used = [(path, raw) for path, raw in readable if raw.size == size]
    pattern = most_common_pattern([raw.grids for _, raw in used])
    recognized = None if board else recognize_board(used, pattern, files.read, square=square)
    if recognized is not None:
        return replace(detect_in_set(files, recognized.board, None), assumption=recognized.assumption)
    if board is None and pattern is not None:
        board = Checkerboard(*pattern, square=square)
    field = estimate_set_field(used, files.read, cache=files.cache)
    images = [_image_detection(path, raw, board, size) for path, raw in zip(paths, results, strict=True)]
    images = [with_field_remark(image, field) for image in images]
    drawn = [isinstance(raw, RawDetections) and raw.drawn_on for raw in results]
    images, notes = leave_out_drawn_corners(images, drawn)
    if board is not None:
        images, copies = leave_out_undistorted_copies(images, board)
        notes += copies
    if size is not None:
        notes += filter(None, [sizes_note([(path.name, raw.size) for path, raw in readable], size)])
        images = images if files.apply_exif else _with_orientation_remark(images, results)
        images, note = with_duplicate_remarks(images, size)
        notes += note
    if board is not None and not isinstance(board, Checkerboard):
        notes += mirrored_markers_note(images, board)
    if isinstance(board, Checkerboard) and board.columns < board.rows and any(image.boards for image in images):
        notes.append(
            f"the {board} board is a {board.rows}x{board.columns} board rotated by 90°: the camera is the same, and"
            " the x axis of its poses is along the shorter side"
        )
    hint = None
    if isinstance(board, Checkerboard):
        hint = _pattern_hint([raw for _, raw in used], images, board, pattern)
    return Detections(board, images, hint, field, tuple(notes))


def detect_checkerboard(gray: NDArray[np.uint8], board: Checkerboard) -> Detection | None:
    """Detect a checkerboard in a gray image (H, W) of uint8; None if there is none.

    Of several checkerboards, the one with most corners is returned. Corners that are inconsistent with their neighbours
    are left out, so the result may hold part of the board.

    Raises
    ------
    ValueError
        If `gray` is not an 8-bit gray image.
    """
    return next(iter(detect(gray, board)), None)


def _image_detection(
    path: Path, raw: RawDetections | UnreadableImage, board: Board | None, size: tuple[int, int] | None
) -> ImageDetection:
    if isinstance(raw, UnreadableImage):
        return ImageDetection(path, note=reason_without_name(raw, path))
    if size is not None and raw.size != size:
        return ImageDetection(path, note=size_mismatch_note(raw.size, size))
    detections = [replace(detection, board=board) for detection in raw.boards]  # cached without it
    assigned: list[CornerGrid] = []
    if isinstance(board, Checkerboard):
        for grid in raw.grids:
            detection = assign_to_board(grid, board)
            if detection is not None:
                detections.append(detection)
                assigned.append(grid)
    image = ImageDetection(
        path,
        raw.size,
        tuple(detections),
        _note(raw, detections, board),
        sharpness=raw.sharpness,
        exposure=assigned[0].white if assigned else raw.exposure,
        blur=assigned[0].blur if assigned else float("nan"),
    )
    return image.with_remark("interlaced: only the even rows are used") if raw.interlaced else image


def _note(raw: RawDetections, detections: Sequence[Detection], board: Board | None) -> str:
    if board is None:
        return "no board detected"
    if not detections:
        columns, rows = raw.grids[0].pattern if raw.grids else (0, 0)
        return f"no {board} board detected" + (f", but one of {columns}x{rows}" if raw.grids else "")
    return boards_note(detections, board)


def _with_orientation_remark(
    images: Sequence[ImageDetection], results: Sequence[RawDetections | UnreadableImage]
) -> list[ImageDetection]:
    """Add a remark to the first image whose EXIF orientation is ignored."""
    remarked = list(images)
    for i, raw in enumerate(results):
        if isinstance(raw, RawDetections) and raw.orientation != 1:
            remarked[i] = images[i].with_remark(
                f"EXIF orientation {raw.orientation} ignored, here and in the other images: the sensor does not rotate"
            )
            break
    return remarked


def _pattern_hint(
    raw: Sequence[RawDetections], images: Sequence[ImageDetection], board: Checkerboard, pattern: Pattern | None
) -> str | None:
    """Return a hint if more images show another checkerboard than the requested one."""
    if pattern is None or sorted(pattern) == sorted((board.columns, board.rows)):
        return None
    count = sum(any(grid.pattern == pattern for grid in r.grids) for r in raw)
    complete = sum(any(len(d) > MIN_FILLED_SHARE * board.size for d in image.boards) for image in images)
    if count <= complete:
        return None
    columns, rows = pattern
    return (
        f"found a grid of {columns}x{rows} inner corners ({squares_text(columns, rows)}) in {count}/{len(raw)} images,"
        f" but the requested board is {board} ({squares_text(board.columns, board.rows)}). Use --pattern"
        f" {columns}x{rows} or --squares {columns + 1}x{rows + 1}."
    )
