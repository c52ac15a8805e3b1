"""Checks of detections in a set of images: duplicates, mirrored markers, corners outside of the image circle."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from omnisight.cache import frames_folder
from omnisight.images import ImageField
from omnisight.targets.boards import Board
from omnisight.targets.detections import Detection, ImageDetection
from omnisight.targets.duplicates import MAX_COPY_MOVEMENT_PX, find_duplicates

# Distance, px, of a corner outside of the image circle, whose edge is known to a pixel.
MAX_OUTSIDE_PX = 2.0
# Names of images in a note.
MAX_NAMES = 5


def with_duplicate_remarks(
    images: Sequence[ImageDetection], size: tuple[int, int]
) -> tuple[list[ImageDetection], list[str]]:
    """Add remarks to the images that repeat an earlier one; return them, and a note on the set."""
    duplicates = find_duplicates([image.boards for image in images], size)
    remarked = list(images)
    for i, (other, moved) in duplicates.items():
        name = images[other].path.name
        same = moved < MAX_COPY_MOVEMENT_PX
        remarked[i] = images[i].with_remark(
            f"the same as {name}" if same else f"nearly the same as {name} (moved by {moved:.1f} px)"
        )
    if not duplicates:
        return remarked, []
    count = sum(bool(image.boards) for image in images)
    farthest = max(moved for _, moved in duplicates.values())
    is_clip = frames_folder() in images[0].path.parents
    video = "" if is_clip else ", or use the video itself: its most informative frames are selected"
    names = [images[i].path.name for i in duplicates]
    listed = ", ".join(names[:MAX_NAMES]) + (" ..." if names[MAX_NAMES:] else "")
    note = (
        f"{len(names)} of {count} images with a board {'repeat' if names[1:] else 'repeats'} another one (no corner"
        f" moved by more than {farthest:.1f} px: {listed}): copies add no information, and make uncertainties too"
        f" small; move and tilt the board between images{video}"
    )
    return remarked, [note]


def mirrored_markers_note(images: Sequence[ImageDetection], board: Board) -> list[str]:
    """Return a note if markers are decoded in mirror images."""
    names = [image.path.name for image in images if any(is_mirrored(d, board) for d in image.boards)]
    if not names:
        return []
    count = sum(bool(image.boards) for image in images)
    which = "all" if len(names) == count else f"{len(names)} of {count}"
    return [
        f"the markers match only when mirrored in {which} images with a board ({', '.join(names[:3])}"
        f"{', ...' if len(names) > 3 else ''}): is a webcam's mirror mode on? Turn it off; only a camera that looks"
        " into a mirror sees the board like that"
    ]


def is_mirrored(detection: Detection, board: Board) -> bool:
    """Return whether a board's points form a mirror image.

    Most triangles of neighbouring points must be mirrored: a lens may bend the board around the image's centre. The
    numbering of a board without markers follows from the image, so it never appears mirrored.
    """
    from scipy.spatial import Delaunay, QhullError

    points = board.points[detection.ids, :2]
    try:
        triangles = Delaunay(points).simplices
    except (QhullError, ValueError):  # all on a line, or too few
        return False
    turns = _doubled_area(points[triangles]) * _doubled_area(detection.pixels[triangles])
    return bool(np.count_nonzero(turns < 0) > np.count_nonzero(turns > 0))


def with_field_remark(image: ImageDetection, field: ImageField | None) -> ImageDetection:
    """Add a remark if corners lie outside of the image field."""
    if field is None or not image.boards:
        return image
    outside = sum(int((~field.contains(d.pixels, -MAX_OUTSIDE_PX)).sum()) for d in image.boards)
    return image.with_remark(f"{outside} corners outside of the image circle") if outside else image


def _doubled_area(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return twice the signed area of triangles (N, 3, 2)."""
    (a, b), (c, d) = (triangles[:, k].T - triangles[:, 0].T for k in (1, 2))
    return a * d - b * c
