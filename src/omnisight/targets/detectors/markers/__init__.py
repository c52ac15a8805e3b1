"""Detect boards with markers: markers are decoded, then the points around them are predicted and measured."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.boards._marker_board import MarkerBoard
from omnisight.targets.detections import Detection
from omnisight.targets.detectors.markers.decoding import decode_markers, select_board_markers
from omnisight.targets.detectors.markers.point_search import find_points, measure

__all__ = ["detect", "measure"]


def detect(gray: NDArray[np.uint8], board: MarkerBoard) -> list[Detection]:
    """Detect a board with markers, printed black on white, or white on black.

    In a mirror image, as a camera sees a board in a mirror, ids are right, and the step to the next row is
    anticlockwise of the step to the next column. If the markers are those of a variant of the board, such as another
    layout, that variant is detected: the note of the detection names it, and ids are those of the requested board.

    Returns
    -------
    list of Detection
        One, or none.
    """
    detection = _detect_black_on_white(gray, board) or _detect_black_on_white(255 - gray, board)
    return [] if detection is None else [detection]


def _detect_black_on_white(gray: NDArray[np.uint8], board: MarkerBoard) -> Detection | None:
    """Detect a board with black markers."""
    variants = board.variants()
    layouts = [variant.board.layout for variant in variants]
    markers = decode_markers(
        gray,
        layouts[0].dictionary,
        range(first := layouts[0].first_marker, first + max(len(layout.marker_corners) for layout in layouts)),
        layouts[0].border,
        lambda decoded: any(
            len(select_board_markers(decoded, layout.marker_corners).ids) == len(layout.marker_corners)
            for layout in layouts
        ),
    )
    candidates = [select_board_markers(markers, layout.marker_corners) for layout in layouts]
    # A variant must fit better by two markers: within one row of markers, two layouts differ by a shift only.
    best = max(range(len(variants)), key=lambda k: (len(candidates[k].ids) - (k > 0), -k))
    detection = find_points(gray, candidates[best], variants[best].board)
    if detection is None:
        return None
    ids = variants[best].ids[detection.ids]
    order = np.argsort(ids)
    return replace(
        detection,
        ids=ids[order],
        pixels=detection.pixels[order],
        covariance=detection.covariance[order],
        note=variants[best].note,
        board=board,
    )
