"""The three detectors behind one interface, and the score of their corners against the truth."""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from omnisight.targets import Checkerboard, detect_checkerboard

Array = NDArray[np.float64]
Gray = NDArray[np.uint8]

NEAR = 2.0  # px: a corner this far from a true one is right
MEDIAN_OF_TWO = 2 * np.log(2)  # of chi-square with two degrees of free_parameters


@dataclass(frozen=True, eq=False)
class Found:
    """Corners that a detector gives.

    Attributes
    ----------
    ids
        (N,) rows of `board.points` by the detector's own order.
    pixels
        (N, 2).
    covariance
        (N, 2, 2), or None where the detector does not tell.
    seconds
        Time taken.
    located
        Whether the detector is sure of the ids.
    """

    ids: NDArray[np.int64]
    pixels: Array
    covariance: Array | None = None
    seconds: float = 0.0
    located: bool = True

    def __len__(self) -> int:
        return len(self.ids)


def ours(gray: Gray, board: Checkerboard) -> Found:
    found = detect_checkerboard(gray, board)
    if found is None:
        return nothing()
    return Found(found.ids, found.pixels, found.covariance, located=found.located)


def classic(gray: Gray, board: Checkerboard) -> Found:
    """Find by cv2.findChessboardCorners, refined in windows that reach a third of the way to the nearest corner."""
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    good, corners = cv2.findChessboardCorners(gray, (board.columns, board.rows), flags=flags)
    if not good:
        return nothing()
    corners = corners.reshape(-1, 1, 2).astype(np.float32)
    spacing = cKDTree(corners[:, 0]).query(corners[:, 0], 2)[0][:, 1]
    reach = np.maximum(np.rint(spacing / 3), 2).astype(int)
    until = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-4)
    for size in np.unique(reach):
        rows = reach == size
        window = (int(size), int(size))
        corners[rows] = cv2.cornerSubPix(gray, np.ascontiguousarray(corners[rows]), window, (-1, -1), until)
    return _whole(corners)


def sector_based(gray: Gray, board: Checkerboard) -> Found:
    flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    good, corners = cv2.findChessboardCornersSB(gray, (board.columns, board.rows), flags=flags)
    return _whole(corners) if good else nothing()


DETECTORS: dict[str, Callable[[Gray, Checkerboard], Found]] = {
    "omnisight": ours,
    "OpenCV classic": classic,
    "OpenCV SB": sector_based,
}
"""By the names that the tables use."""


def timed(name: str, gray: Gray, board: Checkerboard) -> Found:
    start = time.perf_counter()
    found = DETECTORS[name](gray, board)
    return replace(found, seconds=time.perf_counter() - start)


def nothing() -> Found:
    return Found(np.zeros(0, np.int64), np.zeros((0, 2)))


def _whole(corners: NDArray[np.float32]) -> Found:
    pixels = corners.reshape(-1, 2).astype(float)
    return Found(np.arange(len(pixels)), pixels)


@dataclass(frozen=True, eq=False)
class Score:
    """What of an image was found.

    Attributes
    ----------
    visible
        How many corners are.
    reported
        How many the detector gave, without those that lie on a true corner too near the border to count either way.
    errors
        (N, 2) of the right ones: found minus true, px.
    nees
        (N,) e^T C^-1 e / 2 of the right ones; empty where the detector does not tell the covariance.
    misnamed
        Corners in the right place that have another corner's id.
    seconds
        Time taken.
    """

    visible: int
    reported: int
    errors: Array
    nees: Array
    misnamed: int
    seconds: float

    @property
    def right(self) -> int:
        return len(self.errors)

    @property
    def clean(self) -> bool:
        """Whether nothing is missing or wrong."""
        return self.right == self.visible == self.reported


def score(
    found: Found, corners: Array, visible: NDArray[np.bool_], names: NDArray[np.int64] | None, *, strict: bool
) -> Score:
    """Count corners; `names` (54,) are the ids that the true corners should have, None where ids are not judged.

    Where not `strict`, a wrong id is no error.
    """
    total = int(visible.sum())
    in_image = np.isfinite(corners).all(1)
    if not len(found) or not in_image.any():
        return Score(total, len(found), np.zeros((0, 2)), np.zeros(0), 0, found.seconds)
    true = np.flatnonzero(in_image)
    distance, nearest = cKDTree(corners[true]).query(found.pixels)
    at = true[nearest]
    on_corner = distance < NEAR
    uncounted = on_corner & ~visible[at]
    right = on_corner & visible[at]
    misnamed = np.zeros(len(found), bool) if names is None else right & (found.ids != names[at])
    # Two corners on one true corner: the second is wrong.
    order = np.lexsort((distance, at))
    again = np.zeros(len(found), bool)
    again[order[1:]] = at[order[1:]] == at[order[:-1]]
    right &= ~again
    if strict:
        right &= ~misnamed
    errors = found.pixels[right] - corners[at[right]]
    nees = np.zeros(0)
    if found.covariance is not None and len(errors):
        nees = np.einsum("ni,ni->n", errors, np.linalg.solve(found.covariance[right], errors[..., None])[..., 0]) / 2
    return Score(total, len(found) - int(uncounted.sum()), errors, nees, int(misnamed.sum()), found.seconds)


def summary(scores: Iterable[Score]) -> dict[str, float]:
    """Sum up the scores of many images."""
    scores = list(scores)
    errors = np.concatenate([s.errors for s in scores] or [np.zeros((0, 2))])
    nees = np.concatenate([s.nees for s in scores] or [np.zeros(0)])
    visible, reported = sum(s.visible for s in scores), sum(s.reported for s in scores)
    seconds = [s.seconds for s in scores]
    squared = (errors**2).sum(1)
    return {
        "images": len(scores),
        "found": sum(s.right > 0 for s in scores),
        "recall": len(errors) / max(visible, 1),
        "precision": len(errors) / reported if reported else float("nan"),
        "wrong": reported - len(errors),
        "misnamed": sum(s.misnamed for s in scores),
        "rms": float(np.sqrt(squared.mean())) if len(errors) else float("nan"),
        "p95": float(np.sqrt(np.percentile(squared, 95))) if len(errors) else float("nan"),
        "nees": float(nees.mean()) if len(nees) else float("nan"),
        "nees_median": float(2 * np.median(nees) / MEDIAN_OF_TWO) if len(nees) else float("nan"),
        "seconds": float(np.median(seconds)) if seconds else float("nan"),
        "slowest": float(max(seconds, default=float("nan"))),
    }
