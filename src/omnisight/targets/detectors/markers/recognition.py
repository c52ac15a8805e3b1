"""Recognize an unspecified board with markers: the dictionary of its markers, and how they are arranged."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.boards._aruco import dictionary_named, marker_count
from omnisight.targets.detectors.markers.decoding import MIN_PERIMETER, Markers

Array = NDArray[np.float64]

# Families of markers, each by its dictionaries from the smallest to the largest, which begins with the smaller ones;
# and the width of the black border in cells, two for the tags of Kalibr.
FAMILIES = (
    (("DICT_APRILTAG_36h11",), 2),
    *((tuple(f"DICT_{n}X{n}_{count}" for count in (50, 100, 250)), 1) for n in (4, 5, 6, 7)),
    (("DICT_APRILTAG_36h11",), 1),
    (("DICT_ARUCO_ORIGINAL",), 1),
)
# Pixels of the image in which markers are searched.
SEARCHED_PIXELS = 1_000_000
# Markers whose neighbours must agree on the arrangement, and their part of those with neighbours: single markers are
# decoded by chance, and some are decoded as another one.
MIN_AGREEING, MIN_AGREEING_SHARE = 4, 0.6
# Cosine of the angle between a direction of the board and a neighbour in it; a wide lens turns it by some degrees.
MIN_COSINE = 0.9
# Distance of neighbours, in sides of a marker, up to which an affine map holds.
MAX_NEIGHBOUR_SIDES = 5.0
# Deviation of a marker of the next row of a ChArUco board from the middle between two columns, in their distance.
MAX_DIAGONAL_DEVIATION = 0.15


class MarkerArrangement(NamedTuple):
    """Markers in rows.

    Attributes
    ----------
    kind : str
        "charuco"; "aprilgrid", the grid of Kalibr; or "aruco_grid", of markers with nothing between them.
    columns, rows : int
        Inner corners of a ChArUco board, markers of a grid; rows as far as seen.
    dictionary : str
        OpenCV's name of the smallest dictionary that has these markers.
    pitch : float
        Side of a square, or distance of neighbouring markers of a grid, over the side of a marker.
    """

    kind: str
    columns: int
    rows: int
    dictionary: str
    pitch: float


def recognize_markers(grays: Sequence[NDArray[np.uint8]]) -> MarkerArrangement | None:
    """Return the arrangement of the markers in images (H, W) of one board; None if there is none."""
    found: list[MarkerArrangement] = []
    for gray in grays:
        families = [family for family in FAMILIES if not found or found[0].dictionary in family[0]]
        small = _reduced(gray)
        # A camera that looks into a mirror sees mirror images of markers.
        in_image = (_arrangement(image, *family) for image in (small, small[:, ::-1]) for family in families)
        found += [arrangement] if (arrangement := next(filter(None, in_image), None)) else []
    # The image that shows the last marker determines the rows and the dictionary.
    return max(found, key=lambda arrangement: arrangement.rows, default=None)


def _arrangement(gray: NDArray[np.uint8], names: Sequence[str], border: int) -> MarkerArrangement | None:
    """Return the arrangement of the markers of one family in an image."""
    markers = _decode(gray, names[-1], border)
    if len(markers.ids) < MIN_AGREEING:
        return None
    offsets = _offsets(markers)
    across, down = (_neighbours(offsets, axis) for axis in (0, 1))
    to_right, to_below = (_common_step(markers.ids, pairs) for pairs in (across, down))
    if to_right is None or to_below is None or abs(to_right) != 1 or abs(to_below) < 2:
        return None
    distance = float(np.median(np.linalg.norm(offsets[across[:, 0], across[:, 1]], axis=1)))
    half_way = np.linalg.norm(np.abs(offsets) - distance / 2, axis=2).min(axis=1) < MAX_DIAGONAL_DEVIATION * distance
    agreeing = [_agreeing(markers.ids, across, to_right), _agreeing(markers.ids, down, to_below)]
    columns, last = abs(to_below), int(markers.ids[np.concatenate(agreeing)].max())
    dictionary = next(name for name in names if marker_count(name) > last)
    if half_way.mean() > 0.5:
        # Two rows of squares have a marker for each column; the first square has none.
        return MarkerArrangement("charuco", columns - 1, -(-2 * (last + 1) // columns) - 1, dictionary, distance / 2)
    kind = "aprilgrid" if border == 2 else "aruco_grid"
    return MarkerArrangement(kind, columns, last // columns + 1, dictionary, distance)


def _reduced(gray: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the image, reduced for speed if it is large, and slightly blurred against noise."""
    import cv2

    scale = min(1.0, (SEARCHED_PIXELS / gray.size) ** 0.5)
    small = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.GaussianBlur(small, (0, 0), 0.8), np.uint8)


def _decode(gray: NDArray[np.uint8], dictionary: str, border: int) -> Markers:
    """Decode the markers of a dictionary, black on white or white on black."""
    import cv2

    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = border
    parameters.detectInvertedMarker = True
    parameters.minDistanceToBorder = 1
    # Cells are narrow and distorted: only their centres are read, on a fine grid.
    parameters.perspectiveRemovePixelPerCell = 8
    parameters.perspectiveRemoveIgnoredMarginPerCell = 0.3
    parameters.minMarkerPerimeterRate = MIN_PERIMETER
    detector = cv2.aruco.ArucoDetector(dictionary_named(dictionary), parameters)
    corners, ids, _ = detector.detectMarkers(np.ascontiguousarray(gray))
    if not len(corners):
        return Markers(np.zeros(0, np.int64), np.zeros((0, 4, 2)))  # ids are None
    return Markers(np.asarray(ids, np.int64).ravel(), np.asarray(corners, np.float64).reshape(-1, 4, 2))


def _offsets(markers: Markers) -> Array:
    """Return the offsets (N, N, 2) from each marker to the others in its own frame, in sides of a marker."""
    centres = markers.corners.mean(axis=1)
    right = (markers.corners[:, 1] + markers.corners[:, 2] - markers.corners[:, 0] - markers.corners[:, 3]) / 2
    down = (markers.corners[:, 2] + markers.corners[:, 3] - markers.corners[:, 0] - markers.corners[:, 1]) / 2
    inverse = np.linalg.pinv(np.stack([right, down], axis=2))
    return np.einsum("iab,ijb->ija", inverse, centres[None] - centres[:, None])


def _neighbours(offsets: Array, axis: int) -> NDArray[np.intp]:
    """Return pairs (P, 2) of markers: each with the nearest one along +x (axis 0) or +y (axis 1)."""
    distance = np.linalg.norm(offsets, axis=2)
    ahead = (offsets[..., axis] > MIN_COSINE * distance) & (distance > 0.5) & (distance < MAX_NEIGHBOUR_SIDES)
    distance = np.where(ahead, distance, np.inf)
    first = np.flatnonzero(ahead.any(axis=1))
    return np.stack([first, distance[first].argmin(axis=1)], axis=1)


def _common_step(ids: NDArray[np.int64], pairs: NDArray[np.intp]) -> int | None:
    """Return the difference of numbers on which most pairs agree; None if they do not."""
    if len(pairs) < MIN_AGREEING:
        return None
    steps, counts = np.unique(ids[pairs[:, 1]] - ids[pairs[:, 0]], return_counts=True)
    is_common = counts.max() >= max(MIN_AGREEING, MIN_AGREEING_SHARE * len(pairs))
    return int(steps[counts.argmax()]) if is_common else None


def _agreeing(ids: NDArray[np.int64], pairs: NDArray[np.intp], step: int) -> NDArray[np.intp]:
    """Return the markers of the pairs whose numbers differ by a step."""
    return pairs[ids[pairs[:, 1]] - ids[pairs[:, 0]] == step].ravel()
