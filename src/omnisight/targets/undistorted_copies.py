"""Undistorted copies of images in the same set, which a calibration must not use: they show another camera."""

import re
from collections import defaultdict
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.boards import Board
from omnisight.targets.detections import ImageDetection

Array = NDArray[np.float64]

# Pairs of an image and its copy that are enough to compare.
MIN_PAIRS = 3
# Deviation of the copies' corners from a plane seen by a pinhole camera, over that of the originals.
MAX_STRAIGHTNESS_RATIO = 0.5
# Deviation of the copies' corners from one smooth map of the originals, over the size of the board. Two cameras have no
# such map: it depends on the distance of the board.
MAX_MAP_ERROR = 0.03
# Degree of the map.
DEGREE = 5


def leave_out_undistorted_copies(
    images: Sequence[ImageDetection], board: Board
) -> tuple[list[ImageDetection], list[str]]:
    """Leave out images that are undistorted copies of others, with a note; return all images, and a note on the set.

    Copies are paired with their originals by the numbers in the file names, which differ by a word: 7_raw and 7_undist.
    """
    results = list(images)
    for word, pairs in _pairs_by_word(images):
        if len(pairs) >= MIN_PAIRS and _are_copies(pairs, board):
            copies = [i for i, image in enumerate(images) if word in _words(image)]
            for i in copies:
                results[i] = ImageDetection(images[i].path, note="an undistorted copy of another image: left out")
            names = ", ".join(images[i].path.name for i in copies[:3]) + (", ..." if len(copies) > 3 else "")
            return results, [f"{len(copies)} images are undistorted copies of others and are left out: {names}"]
    return results, []


def _pairs_by_word(
    images: Sequence[ImageDetection],
) -> Iterator[tuple[str, list[tuple[ImageDetection, ImageDetection]]]]:
    """Yield each word of the file names with the pairs (with it, without it) of images of the same numbers."""
    detected = [image for image in images if len(image.boards) == 1]
    for word in sorted({word for image in detected for word in _words(image)}):
        by_number: defaultdict[tuple[str, ...], tuple[list[ImageDetection], list[ImageDetection]]]
        by_number = defaultdict(lambda: ([], []))
        for image in detected:
            by_number[tuple(re.findall(r"\d+", image.path.stem))][word not in _words(image)].append(image)
        yield word, [(i, j) for with_it, without in by_number.values() for i in with_it[:1] for j in without[:1]]


def _words(image: ImageDetection) -> list[str]:
    return re.findall(r"[a-z]+", image.path.stem.lower())


def _are_copies(pairs: Sequence[tuple[ImageDetection, ImageDetection]], board: Board) -> bool:
    """Return whether the first image of each pair is straighter, and one smooth map of the second one."""
    copies, originals, points = list[Array](), list[Array](), list[Array]()
    for copy, original in ((a.boards[0], b.boards[0]) for a, b in pairs):
        _, here, there = np.intersect1d(copy.ids, original.ids, assume_unique=True, return_indices=True)
        if len(here) > 4:
            copies.append(copy.pixels[here])
            originals.append(original.pixels[there])
            points.append(board.points[copy.ids[here], :2])
    if len(copies) < MIN_PAIRS:
        return False
    bent = [
        np.median([_plane_error(x, p) for x, p in zip(points, sides, strict=True)]) for sides in (copies, originals)
    ]
    if bent[0] > MAX_STRAIGHTNESS_RATIO * bent[1]:
        return False
    source, target = np.concatenate(originals), np.concatenate(copies)
    if len(source) < (DEGREE + 1) * (DEGREE + 2):
        return False
    u, v = ((source - source.mean(0)) / np.abs(source - source.mean(0)).max()).T
    basis = np.stack([u**i * v**j for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i)], axis=1)
    error = target - basis @ np.linalg.lstsq(basis, target, rcond=None)[0]
    size = float(np.median([np.linalg.norm(np.ptp(pixels, axis=0)) for pixels in copies]))
    return bool(np.sqrt((error**2).sum(axis=1).mean()) < MAX_MAP_ERROR * size)


def _plane_error(points: Array, pixels: Array) -> float:
    """Return the rms distance, px, of pixels (N, 2) from the best homography of board points (N, 2)."""
    import cv2

    matrix = np.asarray(cv2.findHomography(points, pixels)[0], np.float64)
    if matrix.shape != (3, 3):  # collinear points
        return float("nan")
    mapped = cv2.perspectiveTransform(points[None], matrix)[0]
    return float(np.sqrt(((mapped - pixels) ** 2).sum(axis=1).mean()))
