"""Decode square markers with OpenCV at several scales, and select those of one board."""

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.boards._aruco import dictionary_named
from omnisight.targets.detection_limits import MAX_SEARCH_PIXELS

Array = NDArray[np.float64]

# Pixels that a larger image is reduced to first, for speed.
FIRST_PIXELS = MAX_SEARCH_PIXELS / 2
# Perimeter of a marker over the image's longer side: below, its bits are smaller than pixels.
MIN_PERIMETER = 0.015
# OpenCV compares each square with each other, so an image of bricks or tiles would take a minute. Squares are counted
# in so many samples each way, a sixteenth of the image in all; past the limit, smaller squares are ignored.
SAMPLES_PER_SIDE = 4
MAX_SAMPLED_SQUARES = 40
# Wrong cells are corrected up to this probability that a square with random cells is decoded as one of the markers. An
# image has some hundred squares, and the few that are decoded by chance contradict their neighbours.
MAX_FALSE_DECODING = 0.01
# Enlarged images are sharpened: scale of the details, px of the original image, and their additional weight. Cells of
# 2.5 px are blurred into each other. On AprilGrids in a fisheye of 512 px this decodes 2.5 times as many markers, and
# 1.4 times as many with noise of 20 gray levels; a weight of 1 decodes 2.1 and 1.4 times as many.
DETAIL_PX, DETAIL_WEIGHT = 1.5, 2.0
# Distance, in sides of a marker, up to which two markers predict each other, and deviation from the prediction over
# that distance: an affine map holds no farther in a wide lens.
MAX_LINK_SIDES, MAX_LINK_DEVIATION = 3.5, 0.4


class Markers(NamedTuple):
    """Decoded markers: their numbers (N,), and their corners (N, 4, 2), px, in the dictionary's order."""

    ids: NDArray[np.int64]
    corners: Array


class _Codes(NamedTuple):
    """The codes that are decoded: some markers of a dictionary, and their mirror images.

    A camera that looks into a mirror sees the mirror images. Searching both at once takes hardly more time than one.

    Attributes
    ----------
    name, numbers
        OpenCV's name of the dictionary, and the markers.
    border
        Width of a marker's black border in cells.
    mirrored_first
        Whether the mirror images are the first half of the codes, or the second.
    """

    name: str
    numbers: range
    border: int
    mirrored_first: bool

    @property
    def dictionary(self) -> Any:
        """OpenCV's dictionary of the codes."""
        import cv2

        original = dictionary_named(self.name)
        side = original.markerSize
        own = original.bytesList[self.numbers.start : self.numbers.stop]
        bits = [cv2.aruco.Dictionary.getBitsFromByteList(own[k : k + 1], side) for k in range(len(own))]
        mirrored = [cv2.aruco.Dictionary.getByteListFromBits(np.ascontiguousarray(b[:, ::-1])) for b in bits]
        halves = [*mirrored, own] if self.mirrored_first else [own, *mirrored]
        return cv2.aruco.Dictionary(np.concatenate(halves), side, original.maxCorrectionBits)


def decode_markers(
    gray: NDArray[np.uint8], dictionary: str, numbers: range, border: int, is_complete: Callable[[Markers], bool]
) -> Markers:
    """Decode some markers of a dictionary in an image, or in its mirror image.

    Parameters
    ----------
    gray : (H, W) array of uint8
    dictionary : str
        OpenCV's name.
    numbers : range
        The markers in the dictionary; the first of them is decoded as number 0.
    border : int
        Width of a marker's black border in cells.
    is_complete : callable
        Called with the markers decoded so far after each scale; if it returns True, no further scale is tried.
    """
    decoded, is_mirrored = _decode(gray, _Codes(dictionary, numbers, border, mirrored_first=False), is_complete)
    if is_mirrored:
        # OpenCV returns the first code that is similar enough, which may be that of another marker in a mirror image.
        decoded, _ = _decode(gray, _Codes(dictionary, numbers, border, mirrored_first=True), is_complete)
    return decoded


def _decode(gray: NDArray[np.uint8], codes: _Codes, is_complete: Callable[[Markers], bool]) -> tuple[Markers, bool]:
    """Return the markers at all scales, and whether most of them are mirrored."""
    import cv2

    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = codes.border
    parameters.minDistanceToBorder = 1
    # Cells are narrow and distorted: only their centres are read, on a fine grid.
    parameters.perspectiveRemovePixelPerCell = 8
    parameters.perspectiveRemoveIgnoredMarginPerCell = 0.3
    known = codes.dictionary
    parameters.errorCorrectionRate = _correction_rate(known)
    detector, count = cv2.aruco.ArucoDetector(known, parameters), len(codes.numbers)
    decoded, mirrored_count = Markers(np.zeros(0, np.int64), np.zeros((0, 4, 2))), 0
    for image, scale in _scaled_images(gray):
        parameters.minMarkerPerimeterRate = _min_perimeter(image, count)
        detector.setDetectorParameters(parameters)
        corners, ids, _ = detector.detectMarkers(image)
        if not len(corners):
            continue  # ids are None
        ids, corners = np.asarray(ids, np.int64).ravel(), np.asarray(corners, np.float64).reshape(-1, 4, 2)
        mirrored = (ids >= count) != codes.mirrored_first
        mirrored_count += int(mirrored.sum()) - int((~mirrored).sum())
        # The top left of a mirrored marker is the top right of the marker.
        corners[mirrored] = corners[mirrored][:, [1, 0, 3, 2]]
        decoded = _merged(decoded, Markers(ids % count, (corners + 0.5) / scale - 0.5))
        if is_complete(decoded):
            break
    return decoded, mirrored_count > 0


def select_board_markers(markers: Markers, marker_corners: Array) -> Markers:
    """Select the markers of one board: the largest group in which neighbours agree on each other's position.

    Parameters
    ----------
    markers : Markers
    marker_corners : (M, 4, 2) array
        Corners of all markers on the board; markers of other numbers are dropped.
    """
    from scipy.sparse.csgraph import connected_components

    known = markers.ids < len(marker_corners)
    markers = Markers(markers.ids[known], markers.corners[known])
    if not len(markers.ids):
        return markers
    on_board = marker_corners[markers.ids]
    centre, pixel = on_board.mean(axis=1), markers.corners.mean(axis=1)
    square = on_board - centre[:, None]
    # The scatter of a square's corners is a multiple of the identity, so the affine map has a closed form.
    scatter = (square[..., 0] ** 2).sum(axis=1)[:, None, None]
    jacobian = np.swapaxes(markers.corners - pixel[:, None], 1, 2) @ square / scatter
    area = np.linalg.det(jacobian)
    regular = np.abs(area) > 1e-9 * np.abs(area).max()
    inverse = np.linalg.inv(np.where(regular[:, None, None], jacobian, np.eye(2)))
    predicted = np.einsum("iab,ijb->ija", inverse, pixel[None] - pixel[:, None])
    offset = centre[None] - centre[:, None]
    distance, error = np.linalg.norm(offset, axis=2), np.linalg.norm(predicted - offset, axis=2)
    side = np.linalg.norm(marker_corners[0, 0] - marker_corners[0, 1])
    agree = (distance > 0.5 * side) & (distance < MAX_LINK_SIDES * side) & (error < MAX_LINK_DEVIATION * distance)
    agree &= agree.T & regular & regular[:, None] & (np.sign(area)[:, None] == np.sign(area))
    _, group = connected_components(agree, directed=False)
    largest = group == np.argmax(np.bincount(group))
    # Of two markers with one number, keep the one that more of the others confirm.
    order = np.argsort(-agree.sum(axis=1), kind="stable")
    order = order[largest[order]]
    _, first = np.unique(markers.ids[order], return_index=True)
    return Markers(markers.ids[order[first]], markers.corners[order[first]])


def _min_perimeter(gray: NDArray[Any], count: int) -> float:
    """Return the smallest perimeter of a square to examine, over the image's longer side.

    It is `MIN_PERIMETER` unless an image is full of squares: then the largest are kept, besides those of a board of
    `count` markers, as many squares between them, and the squares inside the markers.
    """
    import cv2

    n = SAMPLES_PER_SIDE
    height, width = gray.shape[0] // (4 * n), gray.shape[1] // (4 * n)
    if min(height, width) < 16:
        return MIN_PERIMETER
    parameters = cv2.aruco.DetectorParameters()
    parameters.minMarkerPerimeterRate = MIN_PERIMETER * max(gray.shape) / max(height, width)
    parameters.minDistanceToBorder = 1
    parameters.perspectiveRemovePixelPerCell = 1  # only squares are wanted, fast; any dictionary will do
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), parameters)
    perimeters: list[float] = []
    for y in range(n):
        for x in range(n):
            top = (2 * y + 1) * gray.shape[0] // (2 * n) - height // 2
            left = (2 * x + 1) * gray.shape[1] // (2 * n) - width // 2
            part = np.ascontiguousarray(gray[top : top + height, left : left + width])
            perimeters += [cv2.arcLength(square, True) for square in detector.detectMarkers(part)[2]]
    max_squares = MAX_SAMPLED_SQUARES + 3 * count // 16
    if len(perimeters) <= max_squares:
        return MIN_PERIMETER
    # Squares of one texture differ in size by a fifth.
    return max(MIN_PERIMETER, 1.2 * sorted(perimeters)[-max_squares] / max(gray.shape))


def _correction_rate(dictionary: Any) -> float:
    """Return the share of the dictionary's correctable cells that are corrected; see `MAX_FALSE_DECODING`."""
    cells, correctable = dictionary.markerSize**2, dictionary.maxCorrectionBits
    # Every marker is compared in four orientations.
    codes, corrected, patterns = 4 * len(dictionary.bytesList), 0, 1
    while corrected < correctable:
        patterns += math.comb(cells, corrected + 1)
        if codes * patterns > MAX_FALSE_DECODING * 2**cells:
            break
        corrected += 1
    # OpenCV rounds the product with `correctable` down.
    return (corrected + 0.5) / max(correctable, 1)


def _scaled_images(gray: NDArray[np.uint8]) -> Iterator[tuple[NDArray[Any], float]]:
    """Yield the image at several scales, the one that most likely decodes first.

    Large markers are decoded in a slightly blurred image, because noise and jagged edges break their outlines. For
    small markers the image is enlarged and sharpened: two dark squares that touch at a corner, as on an AprilGrid, are
    separated only by many pixels, and cells of few pixels are blurred into each other.
    """
    import cv2

    if min(gray.shape) < 8:
        return
    enlargement = min(2.0, (MAX_SEARCH_PIXELS / gray.size) ** 0.5)
    is_small = gray.size <= MAX_SEARCH_PIXELS * 0.8
    scales = [1.0, enlargement, 0.5] if is_small else [(FIRST_PIXELS / gray.size) ** 0.5, 1.0]
    for scale in scales:
        if scale == 1.0:
            yield cv2.GaussianBlur(gray, (0, 0), 0.8), scale
        elif scale > 1.2:
            large = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
            smooth = cv2.GaussianBlur(large, (0, 0), DETAIL_PX * scale)
            yield cv2.addWeighted(large, 1 + DETAIL_WEIGHT, smooth, -DETAIL_WEIGHT, 0), scale
        elif scale < 1:
            yield cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), scale


def _merged(known: Markers, new: Markers) -> Markers:
    """Add the new markers except those of the same number and place as a known one."""
    radius = np.linalg.norm(new.corners[:, 0] - new.corners[:, 2], axis=1) / 2
    distance = np.linalg.norm(new.corners.mean(axis=1)[:, None] - known.corners.mean(axis=1), axis=2)
    fresh = ~((distance < radius[:, None]) & (new.ids[:, None] == known.ids)).any(axis=1)
    ids = np.concatenate([known.ids, new.ids[fresh]])
    return Markers(ids, np.concatenate([known.corners, new.corners[fresh]]))
