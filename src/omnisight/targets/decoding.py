"""Square markers in an image, decoded by OpenCV at several scales, and which of them belong to one board."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.boards._markers import dictionary_named

Array = NDArray[np.float64]

_QUICK = 1.2
"""Megapixels that a larger image is reduced to at first."""

_MOST = 2.5
"""Megapixels that a small image is enlarged to at most."""

_SMALLEST = 0.015
"""Least perimeter of a marker over the image's longer side."""

_SAMPLES = 4
"""So many parts of an image each way, a quarter of that long and wide each, are looked at for how many squares it has:
a sixteenth of the image."""

_MOST_SQUARES = 40
"""Squares in that sixteenth past which the smaller ones are left out of the search: OpenCV compares each with each, so
that an image of bricks or tiles would take a minute."""

_BEYOND = 1.2
"""How much larger than those that are left out a square must be: they are not all of one size."""

_FAR = 3.5
"""Distance in sides of a marker up to which two markers are compared."""

_APART = 0.4
"""How far off another marker may be from where one predicts it, over the distance to there."""


class Markers(NamedTuple):
    """Decoded markers: their numbers (N,), and their corners (N, 4, 2) in px in the order of the dictionary's."""

    ids: NDArray[np.int64]
    corners: Array


def decode(
    gray: NDArray[np.uint8], dictionary: str, count: int, border: int, enough: Callable[[Markers], bool]
) -> Markers:
    """Find the first `count` markers of a dictionary in an image, or in its mirror image.

    Parameters
    ----------
    gray : (H, W) array of uint8
    dictionary : str
        OpenCV's name.
    count : int
    border : int
        Width of a marker's black border in cells.
    enough : callable
        Told of what was found after each scale; once it says True, no further scale is tried.
    """
    import cv2

    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = border
    parameters.minDistanceToBorder = 1
    # Cells are narrow and bent: look at their middles only, on a fine grid.
    parameters.perspectiveRemovePixelPerCell = 8
    parameters.perspectiveRemoveIgnoredMarginPerCell = 0.3
    detector = cv2.aruco.ArucoDetector(_with_mirrored(dictionary, count), parameters)
    found = Markers(np.zeros(0, np.int64), np.zeros((0, 4, 2)))
    for scaled, scale in _scaled(gray):
        parameters.minMarkerPerimeterRate = _least_perimeter(scaled, count)
        detector.setDetectorParameters(parameters)
        corners, ids, _ = detector.detectMarkers(scaled)
        if not len(corners):
            continue  # ids are None
        ids, corners = np.asarray(ids, np.int64).ravel(), np.asarray(corners, np.float64).reshape(-1, 4, 2)
        mirrored = ids >= count
        # What is the top left of a mirrored marker is the top right of the marker.
        corners[mirrored] = corners[mirrored][:, [1, 0, 3, 2]]
        found = _merged(found, Markers(ids % count, (corners + 0.5) / scale - 0.5))
        if enough(found):
            break
    return found


def _least_perimeter(gray: NDArray[Any], count: int) -> float:
    """Give the least perimeter of a square worth looking at, over the image's longer side.

    It is `_SMALLEST`, unless an image is full of squares: then so much that few enough are left, besides those of a
    board of `count` markers, as many squares between them, and what is in the markers.
    """
    import cv2

    height, width = gray.shape[0] // (4 * _SAMPLES), gray.shape[1] // (4 * _SAMPLES)
    if min(height, width) < 16:
        return _SMALLEST
    parameters = cv2.aruco.DetectorParameters()
    parameters.minMarkerPerimeterRate = _SMALLEST * max(gray.shape) / max(height, width)
    parameters.minDistanceToBorder = 1
    parameters.perspectiveRemovePixelPerCell = 1  # any dictionary will do: only squares are wanted, fast
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), parameters)
    perimeters: list[float] = []
    for y in range(_SAMPLES):
        for x in range(_SAMPLES):
            top = (2 * y + 1) * gray.shape[0] // (2 * _SAMPLES) - height // 2
            left = (2 * x + 1) * gray.shape[1] // (2 * _SAMPLES) - width // 2
            part = np.ascontiguousarray(gray[top : top + height, left : left + width])
            perimeters += [cv2.arcLength(square, True) for square in detector.detectMarkers(part)[2]]
    most = _MOST_SQUARES + 3 * count // 16
    if len(perimeters) <= most:
        return _SMALLEST
    return max(_SMALLEST, _BEYOND * sorted(perimeters)[-most] / max(gray.shape))


def _with_mirrored(name: str, count: int) -> Any:
    """Give a dictionary of the first markers of another, followed by their mirror images.

    A camera that looks into a mirror sees those, and one search for both costs hardly more than one for either.
    """
    import cv2

    known = dictionary_named(name)
    side = known.markerSize
    bits = [cv2.aruco.Dictionary.getBitsFromByteList(known.bytesList[k : k + 1], side) for k in range(count)]
    mirrored = [cv2.aruco.Dictionary.getByteListFromBits(np.ascontiguousarray(b[:, ::-1])) for b in bits]
    return cv2.aruco.Dictionary(np.concatenate([known.bytesList[:count], *mirrored]), side, known.maxCorrectionBits)


def _scaled(gray: NDArray[np.uint8]) -> Iterator[tuple[NDArray[Any], float]]:
    """Give the image at several scales, the one that most likely decodes first.

    Slightly blurred: noise and jagged edges cost more markers than sharpness wins. Two dark squares that touch at a
    corner, as all do on an AprilGrid, come apart only where pixels are many: so small images are enlarged.
    """
    import cv2

    if min(gray.shape) < 8:
        return
    size = gray.size / 1e6
    larger = min(2.0, (_MOST / size) ** 0.5)
    scales = [1.0, larger, 0.5] if size <= 1.7 * _QUICK else [(_QUICK / size) ** 0.5, 1.0]
    for scale in scales:
        if scale == 1.0:
            yield cv2.GaussianBlur(gray, (0, 0), 0.8), scale
        elif scale > 1.2:
            wide = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
            yield cv2.GaussianBlur(wide, (0, 0), 1.2), scale
        elif scale < 1:
            yield cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), scale


def _merged(known: Markers, new: Markers) -> Markers:
    """Add the new markers that are not among the known ones: same number, same place."""
    reach = np.linalg.norm(new.corners[:, 0] - new.corners[:, 2], axis=1) / 2
    apart = np.linalg.norm(new.corners.mean(axis=1)[:, None] - known.corners.mean(axis=1), axis=2)
    fresh = ~((apart < reach[:, None]) & (new.ids[:, None] == known.ids)).any(axis=1)
    ids = np.concatenate([known.ids, new.ids[fresh]])
    return Markers(ids, np.concatenate([known.corners, new.corners[fresh]]))


def linked(markers: Markers, places: Array) -> Markers:
    """Keep the markers of one board: the largest group in which neighbours are where each expects the other.

    Parameters
    ----------
    markers : Markers
    places : (M, 4, 2) array
        Corners of all markers on the board.
    """
    from scipy.sparse.csgraph import connected_components

    if not len(markers.ids):
        return markers
    on_board = places[markers.ids]
    middle, centre = on_board.mean(axis=1), markers.corners.mean(axis=1)
    square = on_board - middle[:, None]
    # Corners of a square: their scatter is a multiple of the identity, so the affine map needs no solving.
    jacobian = (
        np.swapaxes(markers.corners - centre[:, None], 1, 2) @ square / (square[..., 0] ** 2).sum(axis=1)[:, None, None]
    )
    area = np.linalg.det(jacobian)
    proper = np.abs(area) > 1e-9 * np.abs(area).max()
    inverse = np.linalg.inv(np.where(proper[:, None, None], jacobian, np.eye(2)))
    expected = np.einsum("iab,ijb->ija", inverse, centre[None] - centre[:, None])
    offset = middle[None] - middle[:, None]
    distance, error = np.linalg.norm(offset, axis=2), np.linalg.norm(expected - offset, axis=2)
    side = np.linalg.norm(places[0, 0] - places[0, 1])
    agree = (distance > 0.5 * side) & (distance < _FAR * side) & (error < _APART * distance)
    agree &= agree.T & proper & proper[:, None] & (np.sign(area)[:, None] == np.sign(area))
    _, group = connected_components(agree, directed=False)
    best = group == np.argmax(np.bincount(group))
    # Of two with one number in a group, the one that more of the others confirm.
    order = np.argsort(-agree.sum(axis=1), kind="stable")
    order = order[best[order]]
    _, first = np.unique(markers.ids[order], return_index=True)
    kept = order[first]
    return Markers(markers.ids[kept], markers.corners[kept])
