"""Images of a set that show a board in the same pose as an earlier one."""

import math
from collections import Counter, defaultdict
from collections.abc import Sequence

import numpy as np

from omnisight.targets.detections import Detection

# Movement, px, below which two images are copies of one.
MAX_COPY_MOVEMENT_PX = 0.5
# Movement over the image's diagonal below which the second image adds next to nothing.
MAX_DUPLICATE_MOVEMENT = 0.005
# Part of the points of either board that both must show to be compared.
MIN_COMMON_SHARE = 0.8
# Points that two images must have in the same squares before all are compared: fewer are so by chance in many pairs.
MIN_COMMON_POINTS = 3
NEIGHBOURS = [(row, column) for row in (-1, 0, 1) for column in (-1, 0, 1)]

# The number of boards of an image, a point of the first board, and the square of the image in which it lies.
_PointSquare = tuple[int, int, int, int]


def find_duplicates(images: Sequence[Sequence[Detection]], size: tuple[int, int]) -> dict[int, tuple[int, float]]:
    """Find the images that repeat an earlier one.

    Only images with points in the same squares are compared, so the time grows linearly with their number.

    Parameters
    ----------
    images : sequence of sequence of Detection
        The boards in each.
    size : (int, int)
        Width and height of all, px.

    Returns
    -------
    dict
        For a repeating image: which earlier one, that itself repeats none, and the largest movement of a point, px.
    """
    limit = max(MAX_DUPLICATE_MOVEMENT * float(np.hypot(*size)), MAX_COPY_MOVEMENT_PX)
    duplicates: dict[int, tuple[int, float]] = {}
    distinct = defaultdict[_PointSquare, list[int]](list)
    for i, boards in enumerate(images):
        squares_of_points = _squares_of_points(boards, limit)
        others = _candidates(squares_of_points, distinct)
        moved = min(((_max_movement(boards, images[j]), j) for j in others), default=(np.inf, -1))
        if moved[0] < limit:
            duplicates[i] = (moved[1], moved[0])
            continue
        for key in squares_of_points:
            distinct[key].append(i)
    return duplicates


def _squares_of_points(boards: Sequence[Detection], side: float) -> list[_PointSquare]:
    """Return the points of the first board and their squares, whose sides have this length, px."""
    if not boards:
        return []
    squares = np.floor(boards[0].pixels / side).astype(int).tolist()
    return [(len(boards), point, *square) for point, square in zip(boards[0].ids.tolist(), squares, strict=True)]


def _candidates(squares_of_points: list[_PointSquare], distinct: defaultdict[_PointSquare, list[int]]) -> list[int]:
    """Return all earlier images that can be repeated: points that moved less than a side are in neighbouring squares.

    An image that lacks as many points as allowed still shares some of those that are looked up, which are distributed
    over the board.
    """
    lacking = len(squares_of_points) - math.ceil(MIN_COMMON_SHARE * len(squares_of_points))
    count = min(len(squares_of_points), lacking + MIN_COMMON_POINTS)
    common = Counter[int]()
    for k in range(count):
        boards, point, column, row = squares_of_points[k * len(squares_of_points) // count]
        for right, down in NEIGHBOURS:
            common.update(distinct.get((boards, point, column + right, row + down), ()))
    return [j for j, points in common.items() if points >= count - lacking]


def _max_movement(boards: Sequence[Detection], others: Sequence[Detection]) -> float:
    """Return the largest movement of a point, px; inf if the boards show different points."""
    farthest = 0.0
    for board, other in zip(boards, others, strict=True):
        _, here, there = np.intersect1d(board.ids, other.ids, assume_unique=True, return_indices=True)
        if len(here) < MIN_COMMON_SHARE * max(len(board), len(other), 1):
            return np.inf
        farthest = max(farthest, float(np.linalg.norm(board.pixels[here] - other.pixels[there], axis=1).max(initial=0)))
    return farthest
