"""Whether a board with markers is seen in a mirror image."""

from __future__ import annotations

import numpy as np

from .boards import Board
from .detection import Detection


def is_mirrored(detection: Detection, board: Board) -> bool:
    """Say whether a board's points lie in the image as in a mirror.

    Triangles of neighbouring points tell it, each for itself: a lens may bend the board around the image's middle.
    Of a board without markers the numbering follows from the image, so it never seems mirrored.
    """
    from scipy.spatial import Delaunay, QhullError

    points = board.points[detection.ids, :2]
    try:
        triangles = Delaunay(points).simplices
    except (QhullError, ValueError):  # all on a line, or too few
        return False
    turns = _doubled_area(points[triangles]) * _doubled_area(detection.pixels[triangles])
    return bool(np.count_nonzero(turns < 0) > np.count_nonzero(turns > 0))


def _doubled_area(triangles: np.ndarray) -> np.ndarray:
    """Give twice the signed area of triangles (N, 3, 2)."""
    (a, b), (c, d) = (triangles[:, k].T - triangles[:, 0].T for k in (1, 2))
    return a * d - b * c
