"""Recognize boards with markers in images for which no board is specified."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from omnisight.images import read_image, to_gray8
from omnisight.targets.detectors.markers.recognition import MarkerArrangement, recognize_markers
from omnisight.targets.raw_detections import RawDetections

# Images, evenly spaced in the set, in which markers are searched.
SEARCHED_IMAGES = 3
# Part of the images that show all corners of one checkerboard, from which the board is no other.
MIN_COMPLETE_SHARE = 0.5


def marker_board_hint(
    images: Sequence[tuple[Path, RawDetections]], pattern: tuple[int, int] | None, *, apply_exif: bool
) -> str | None:
    """Return how to specify the board with markers that images show; None if they show none, or a checkerboard.

    Parameters
    ----------
    images : sequence of (Path, RawDetections)
        Images of one size.
    pattern : (int, int) or None
        The checkerboard that most of them show.
    apply_exif : bool
        Rotate images by their EXIF orientation.
    """
    complete = sum(any(grid.pattern == pattern and grid.present.all() for grid in raw.grids) for _, raw in images)
    if not images or complete >= MIN_COMPLETE_SHARE * len(images):
        return None
    sampled = np.unique(np.linspace(0, len(images) - 1, SEARCHED_IMAGES).round().astype(np.intp))
    grays = [to_gray8(read_image(images[i][0], apply_exif=apply_exif)) for i in sampled]
    found = recognize_markers(grays)
    return None if found is None else _hint(found)


def _hint(found: MarkerArrangement) -> str:
    """Return what the images show, and how to specify it."""
    size, markers = f"{found.columns}x{found.rows}", f"markers of {found.dictionary}"
    if found.kind == "grid":
        return (
            f"the images show a grid of {size} {markers}, which no target describes: use a ChArUco board (omnisight"
            " target make charuco)"
        )
    if found.kind == "charuco":
        what = f"a ChArUco board of {size} inner corners with {markers}"
        options = f"--square 30mm --marker 22mm --dictionary {found.dictionary}"
    else:
        what, options = f"an AprilGrid of {size} tags", "--tag 30mm --spacing 0.3"
    return (
        f"the images show {what}. Describe it, with its lengths as measured: omnisight target make {found.kind} {size}"
        f" {options} -o board.pdf, and specify --target board.json"
    )
