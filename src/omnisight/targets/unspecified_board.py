"""Recognize boards with markers or circles in images for which no board is specified."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.images import to_gray8
from omnisight.images.interlacing import deinterlace
from omnisight.targets.boards import Board
from omnisight.targets.boards.aprilgrid import AprilGrid
from omnisight.targets.boards.aruco_grid import ArucoGrid
from omnisight.targets.boards.charuco import Charuco
from omnisight.targets.boards.circles import CircleGrid
from omnisight.targets.boards.symmetric_circles import SymmetricCircles
from omnisight.targets.detectors import detect
from omnisight.targets.detectors.circles.recognition import recognize_discs
from omnisight.targets.detectors.markers.recognition import MarkerArrangement, recognize_markers
from omnisight.targets.length import format_length
from omnisight.targets.raw_detections import RawDetections
from omnisight.targets.set_field import ReadImage

# Images, evenly spaced in the set, in which markers and circles are searched.
SEARCHED_IMAGES = 3
# Part of the images that show all corners of one checkerboard, from which the board is no other.
MIN_COMPLETE_SHARE = 0.5
# Largest marker that is assumed, over the square of a ChArUco board.
MAX_MARKER_SQUARES = 0.95
# Gap between tags over their side of the grids that Kalibr prints by default.
KALIBR_SPACING = 0.3
# Gaps between separate markers over their side that are plausible.
GAP_SIDES = 0.05, 2.0
# Error of an estimated spacing: a wide lens bends the lines by a percent.
SAME_SPACING = 0.01
# Cross-ratio of tags that are a side apart, which is the most, and cross-ratios whose median is reliable.
MIN_CROSS_RATIO, MIN_CROSS_RATIOS = 4 / 3, 10


class RecognizedBoard(NamedTuple):
    """A board recognized in images, and what was assumed of it, for the user."""

    board: Board
    assumption: str


def recognize_board(
    images: Sequence[tuple[Path, RawDetections]],
    pattern: tuple[int, int] | None,
    read: ReadImage,
    *,
    square: float | None,
) -> RecognizedBoard | None:
    """Return the board with markers or circles that images show; None if they show none, or a checkerboard.

    Parameters
    ----------
    images : sequence of (Path, RawDetections)
        Images of one size.
    pattern : (int, int) or None
        The checkerboard that most of them show.
    read : callable
        Reads the image of a path.
    square : float or None
        Side in metres of a square or of a marker, or the spacing of circles.
    """
    complete = sum(any(grid.pattern == pattern and grid.present.all() for grid in raw.grids) for _, raw in images)
    if not images or complete >= MIN_COMPLETE_SHARE * len(images):
        return None
    sampled = np.unique(np.linspace(0, len(images) - 1, SEARCHED_IMAGES).round().astype(np.intp))
    grays = [deinterlace(to_gray8(read(images[i][0]))) for i in sampled]
    length = square or 1.0
    found = recognize_markers(grays)
    board: Board | None = None if found is None else _marker_board(found, grays, length)
    if board is None and pattern is None:
        board = _circle_board(grays, length)
    if board is None:
        return None
    board = replace(board, relative=square is None)
    return RecognizedBoard(board, _assumption(board))


def _marker_board(found: MarkerArrangement, grays: Sequence[NDArray[np.uint8]], length: float) -> Board:
    if found.kind == "charuco":
        marker = min(1 / found.pitch, MAX_MARKER_SQUARES) * length
        return Charuco(found.columns, found.rows, length, marker, found.dictionary)
    if found.kind == "aprilgrid":
        tags = AprilGrid(found.columns, found.rows, length, KALIBR_SPACING)
        spacing = _measured_spacing(tags, grays) or KALIBR_SPACING
        return tags if abs(spacing - KALIBR_SPACING) < SAME_SPACING else replace(tags, spacing=spacing)
    gap = float(np.clip(found.pitch - 1, *GAP_SIDES)) * length
    markers = ArucoGrid(found.columns, found.rows, length, gap, found.dictionary)
    spacing = _measured_spacing(markers, grays)
    return replace(markers, separation=spacing * length) if spacing else markers


def _measured_spacing(board: AprilGrid | ArucoGrid, grays: Sequence[NDArray[np.uint8]]) -> float | None:
    """Return the gap between markers over their side, from the detected points; None if there are too few.

    Four points on a line, at 0, 1, 1 + s and 2 + s, have the cross-ratio (1 + s)^2 / (s (2 + s)) in every view.
    """
    ratios = [np.zeros(0)]
    x, y, _ = board.points.T
    row_order = np.lexsort([x, y])
    for detection in (detection for gray in grays for detection in detect(gray, board)):
        pixels = np.full((board.size, 2), np.nan)
        pixels[detection.ids] = detection.pixels
        grid = pixels[row_order].reshape(2 * board.rows, 2 * board.columns, 2)
        for table in (grid, grid.swapaxes(0, 1)):
            a, b, c, d = (table[:, k : table.shape[1] - 3 + k : 2] for k in range(4))
            ac, bd, bc, ad = (np.linalg.norm(q - p, axis=2) for p, q in ((a, c), (b, d), (b, c), (a, d)))
            ratios.append((ac * bd / (bc * ad)).ravel())
    ratio = np.concatenate(ratios)
    ratio = ratio[np.isfinite(ratio) & (ratio > MIN_CROSS_RATIO)]
    if len(ratio) < MIN_CROSS_RATIOS:
        return None
    middle = float(np.median(ratio))
    return float(np.sqrt(middle / (middle - 1))) - 1


def _circle_board(grays: Sequence[NDArray[np.uint8]], length: float) -> Board | None:
    """Return the grid of circles that most images show; None if less than half of them show one."""
    found = [arrangement for gray in grays if (arrangement := recognize_discs(gray)) is not None]
    if not found or 2 * len(found) < len(grays):
        return None
    (shape, _), *_ = Counter(each[:3] for each in found).most_common(1)
    diameter = float(np.median([each.diameter for each in found if each[:3] == shape]))
    columns, rows, is_staggered = shape
    return (CircleGrid if is_staggered else SymmetricCircles)(columns, rows, length, diameter * length)


def _assumption(board: Board) -> str:
    """Return what was recognized and assumed, and how to specify it."""
    lengths = board.lengths()
    unit, length = next(iter(lengths.items()))
    described: list[str] = []
    for name, value in board.to_dict().items():
        if name in lengths and name != unit:
            described.append(f"{name} {lengths[name] / length:.3g} {unit}s")
        elif name == "spacing" and name not in lengths:
            described.append(f"{name} {value:.3g}")
        elif name == "dictionary":
            described.append(str(value))
    scale = f"lengths in {unit}s" if board.relative else f"{unit} {format_length(length)}"
    return (
        f"{board.kind} {board}, recognized: {', '.join([*described, scale])}. To specify it, describe it with omnisight"
        f" target {board.kind} {board} and use --target"
    )
