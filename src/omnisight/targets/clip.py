"""Looks for the board in a clip: at the sharpest and stillest frame of each short while."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.images import Clip

from .boards import Board
from .boards.checkerboard import Checkerboard
from .detection import Detection
from .grids.grid import Grid
from .look import look_in
from .placing import agreed_pattern, place

Bytes = NDArray[np.uint8]

# A frame is looked at for each so many seconds, and no more than so many in all.
WHILE_S, MOST_LOOKS = 1 / 8, 240
# Larger frames are averaged down before the board is looked for: to choose frames, corners need not be exact.
LOOK_PIXELS = 3_000_000
# Width (px) to which frames are averaged down to tell how much they move.
SMALL = 320


@dataclass(frozen=True, eq=False)
class SeenFrame:
    """A frame that was looked at.

    Attributes
    ----------
    index : int
    boards : tuple of Detection
        Roughly located, in px of the frame.
    motion : float
        By how much the board moved since the frame before, px; 0 where that is not known.
    grids : bool
        Whether there is a checkerboard of any size.
    """

    index: int
    boards: tuple[Detection, ...]
    motion: float
    grids: bool


@dataclass(frozen=True)
class SeenClip:
    """What a clip shows.

    Attributes
    ----------
    board : Board or None
        The one that was asked for, or that the frames agree on.
    count : int
        Frames in the clip, as far as it was read.
    frames : tuple of SeenFrame
        Those that were looked at.
    """

    board: Board | None
    count: int
    frames: tuple[SeenFrame, ...]

    @property
    def found(self) -> list[SeenFrame]:
        """The frames that show the board."""
        return [frame for frame in self.frames if frame.boards]


@dataclass(frozen=True, eq=False)
class _Moment:
    """A frame and the one before it."""

    index: int
    gray: Bytes
    before: Bytes | None


def look_through(
    clip: Clip, board: Board | None = None, *, progress: Callable[[int, int], None] | None = None
) -> SeenClip:
    """Look for a board in a clip.

    Parameters
    ----------
    clip : Clip
        Read once; no more than a few frames are held.
    board : Board, optional
        Without one a checkerboard is looked for, of the size that most frames agree on.
    progress : callable, optional
        Called with (frames done, frames in all) after each.

    Raises
    ------
    UnreadableImage
        If no frame can be decoded.
    """
    asked = None if board is None or isinstance(board, Checkerboard) else board
    window = max(round(clip.frame_rate * WHILE_S), -(-(clip.declared_frames or 0) // MOST_LOOKS), 1)
    workers = min(8, os.cpu_count() or 1)
    pending: deque[Future[tuple[int, tuple[Grid, ...], tuple[Detection, ...], float]]] = deque()
    done: list[tuple[int, tuple[Grid, ...], tuple[Detection, ...], float]] = []
    best, best_score, count = None, -np.inf, 0
    before, small_before = None, None
    with ThreadPoolExecutor(workers) as pool:

        def look(moment: _Moment) -> None:
            if len(pending) > workers:
                done.append(pending.popleft().result())
            pending.append(pool.submit(_look, moment, asked))

        for frame in clip.frames():
            gray = frame.gray
            small = _small(gray)
            score = _score(gray, small, small_before)
            if best is None or score > best_score:
                best, best_score = _Moment(frame.index, gray, before), score
            count += 1
            if count % window == 0:
                look(best)
                best = None
                if count // window >= MOST_LOOKS:  # it has more frames than it says
                    break
            before, small_before = gray, small
            if progress is not None:
                progress(count, max(clip.declared_frames or 0, count))
        if best is not None:
            look(best)
        done += [future.result() for future in pending]
    if board is None:
        agreed = agreed_pattern([grids for _, grids, _, _ in done])
        board = None if agreed is None else Checkerboard(*agreed)
    frames: list[SeenFrame] = []
    for index, grids, boards, motion in done:
        if isinstance(board, Checkerboard):
            boards = tuple(placed for grid in grids if (placed := place(grid, board)) is not None)
        frames.append(SeenFrame(index, boards, motion, bool(grids)))
    return SeenClip(board, count, tuple(frames))


def _small(gray: Bytes) -> Bytes:
    import cv2

    height, width = gray.shape
    size = min(SMALL, width), max(1, round(height * min(SMALL, width) / width))
    return np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_AREA), np.uint8)


def _score(gray: Bytes, small: Bytes, before: Bytes | None) -> float:
    """Give how sharp and still a frame is, to compare it with those beside it."""
    import cv2

    sharp = cv2.norm(cv2.Laplacian(gray, cv2.CV_16S)) ** 2 / gray.size
    if before is None:
        return -1.0 / (1 + sharp)  # whether it moves is not known: worse than any other
    # Brightness changes by motion times slope (Horn and Schunck, 1981): the ratio of the sums is a motion in px.
    slope = sum(cv2.norm(cv2.Sobel(small, cv2.CV_16S, *way), cv2.NORM_L1) for way in ((1, 0), (0, 1))) / 8
    moved = cv2.norm(small, before, cv2.NORM_L1) / (slope + 1)
    return float(sharp / (1 + moved**2))


def _look(moment: _Moment, asked: Board | None) -> tuple[int, tuple[Grid, ...], tuple[Detection, ...], float]:
    gray, before = moment.gray, moment.before
    shrink = max(1.0, (gray.size / LOOK_PIXELS) ** 0.5)
    if shrink > 1:
        gray, before = (_shrunk(picture, shrink) for picture in (gray, gray if before is None else before))
    scale = np.array(moment.gray.shape[::-1]) / gray.shape[::-1]
    grids, boards = look_in(gray, asked)
    motion = 0.0
    found = [grid.pixels[grid.there] for grid in grids] + [board.pixels for board in boards]
    if found and before is not None:
        motion = _motion(gray, before, max(found, key=len)) * float(scale.max())
    if shrink > 1:
        area = np.outer(scale, scale)
        grids = tuple(
            replace(grid, pixels=(grid.pixels + 0.5) * scale - 0.5, covariance=grid.covariance * area) for grid in grids
        )
        boards = tuple(
            replace(board, pixels=(board.pixels + 0.5) * scale - 0.5, covariance=board.covariance * area)
            for board in boards
        )
    return moment.index, grids, boards, motion


def _shrunk(picture: Bytes, by: float) -> Bytes:
    import cv2

    height, width = picture.shape
    return np.asarray(
        cv2.resize(picture, (round(width / by), round(height / by)), interpolation=cv2.INTER_AREA), np.uint8
    )


def _motion(gray: Bytes, before: Bytes, pixels: NDArray[np.float64]) -> float:
    """Give by how much points moved between two frames, px: the median of what Lucas and Kanade's tracker says."""
    import cv2

    here = pixels.astype(np.float32)[:, None]
    there, found, _ = cv2.calcOpticalFlowPyrLK(gray, before, here, np.empty_like(here))
    moved = np.linalg.norm(there - here, axis=2)[found == 1]
    return float(np.median(moved)) if len(moved) else 0.0
