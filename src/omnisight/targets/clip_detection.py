"""Detect the board in a video: in the sharpest and stillest frame of each short interval."""

import os
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from omnisight.images import Clip, Frame, to_gray8
from omnisight.images.live_camera import CameraFrame
from omnisight.progress import StageProgress, no_progress
from omnisight.targets.boards import Board
from omnisight.targets.boards.checkerboard import Checkerboard
from omnisight.targets.detection_limits import MAX_SEARCH_PIXELS
from omnisight.targets.detections import Detection
from omnisight.targets.detectors.checkerboard.board_assignment import assign_to_board, most_common_pattern
from omnisight.targets.detectors.checkerboard.corner_grid import CornerGrid
from omnisight.targets.raw_detections import grids_or_boards

Gray = NDArray[np.uint8]

# Interval, s, from which one frame is searched, and frames that are searched in all.
INTERVAL_S = 1 / 8
MAX_FRAMES_SEARCHED = 240
# Width, px, of the thumbnails from which motion is estimated.
THUMBNAIL_WIDTH_PX = 320


@dataclass(frozen=True, eq=False)
class FrameDetections:
    """Detections in a frame.

    Attributes
    ----------
    index : int
    boards : tuple of Detection
        Good to about a pixel, in px of the frame.
    motion : float
        Movement of the board since the frame before, px; 0 if unknown.
    has_grid : bool
        Whether there is a checkerboard of any size.
    """

    index: int
    boards: tuple[Detection, ...]
    motion: float
    has_grid: bool


@dataclass(frozen=True)
class ClipDetections:
    """Detections in a video.

    Attributes
    ----------
    board : Board or None
        The requested board, or the one that the frames agree on.
    count : int
        Frames of the video that were read.
    frames : tuple of FrameDetections
        Those that were searched.
    """

    board: Board | None
    count: int
    frames: tuple[FrameDetections, ...]

    @property
    def found(self) -> list[FrameDetections]:
        """Frames that show the board."""
        return [frame for frame in self.frames if frame.boards]


@dataclass(frozen=True, eq=False)
class CandidateFrame:
    """A frame, the one before it, and how suitable it is.

    Attributes
    ----------
    frame
        The frame.
    gray, previous
        Its gray image, and that of the frame before; None for the first.
    score
        How sharp and still it is, relative to its neighbours.
    """

    frame: Frame | CameraFrame
    gray: Gray
    previous: Gray | None
    score: float


@dataclass(frozen=True, eq=False)
class _Searched:
    """What a frame shows before the board is known."""

    index: int
    grids: tuple[CornerGrid, ...]
    boards: tuple[Detection, ...]
    motion: float


def detect_in_clip(clip: Clip, board: Board | None = None, *, progress: StageProgress = no_progress) -> ClipDetections:
    """Detect a board in a video.

    Parameters
    ----------
    clip : Clip
        Read once; only a few frames are kept in memory.
    board : Board, optional
        Without one, checkerboards are detected, of the size that most frames agree on.
    progress : callable, optional
        Called with (frames done, number of frames) after each.

    Raises
    ------
    UnreadableImage
        If no frame can be decoded.
    """
    declared = clip.declared_frames or 0
    interval = max(round(clip.frame_rate * INTERVAL_S), -(-declared // MAX_FRAMES_SEARCHED), 1)
    count = 0

    def counted() -> Iterator[Frame]:
        nonlocal count
        for frame in clip.frames():
            count += 1
            yield frame
            progress(count, max(declared, count))

    # A video may have more frames than it declares.
    candidates = islice(best_of_intervals(counted(), interval), MAX_FRAMES_SEARCHED)
    searched = _search_in_threads(candidates, board)
    if board is None:
        pattern = most_common_pattern([frame.grids for frame in searched])
        board = None if pattern is None else Checkerboard(*pattern)
    frames = [_assigned(frame, board) for frame in searched]
    return ClipDetections(board, count, tuple(frames))


def detect_in_frame(candidate: CandidateFrame, board: Board) -> FrameDetections:
    """Detect a board in one frame, as `detect_in_clip` does."""
    return _assigned(_search(candidate, board), board)


def _assigned(frame: _Searched, board: Board | None) -> FrameDetections:
    """Return the detections of the board in a searched frame."""
    boards = frame.boards
    if isinstance(board, Checkerboard):
        assigned = (assign_to_board(grid, board) for grid in frame.grids)
        boards = tuple(detection for detection in assigned if detection is not None)
    return FrameDetections(frame.index, boards, frame.motion, bool(frame.grids))


def best_of_intervals(frames: Iterable[Frame | CameraFrame], interval: int) -> Iterator[CandidateFrame]:
    """Yield the sharpest and stillest frame of each interval of `interval` frames."""
    best, previous, previous_thumbnail = None, None, None
    for count, frame in enumerate(frames, 1):
        gray = to_gray8(frame.image)
        thumbnail = _thumbnail(gray)
        score = _score(gray, thumbnail, previous_thumbnail)
        if best is None or score > best.score:
            best = CandidateFrame(frame, gray, previous, score)
        if count % interval == 0:
            yield best
            best = None
        previous, previous_thumbnail = gray, thumbnail
    if best is not None:
        yield best


def _search_in_threads(candidates: Iterator[CandidateFrame], board: Board | None) -> list[_Searched]:
    """Search frames while further ones are decoded, a few at a time."""
    workers = min(8, os.cpu_count() or 1)
    pending: deque[Future[_Searched]] = deque()
    searched: list[_Searched] = []
    with ThreadPoolExecutor(workers) as pool:
        for candidate in candidates:
            if len(pending) > workers:
                searched.append(pending.popleft().result())
            pending.append(pool.submit(_search, candidate, board))
        return searched + [future.result() for future in pending]


def _search(candidate: CandidateFrame, board: Board | None) -> _Searched:
    """Detect grids or boards in a frame, reduced if it is large: selecting frames needs no exact corners."""
    gray, previous = candidate.gray, candidate.previous
    reduction = max(1.0, (gray.size / MAX_SEARCH_PIXELS) ** 0.5)
    gray = _reduced(gray, reduction)
    scale = np.array(candidate.gray.shape[::-1]) / gray.shape[::-1]
    grids, boards = grids_or_boards(gray, board)
    motion = 0.0
    pixels = [grid.pixels[grid.present] for grid in grids] + [b.pixels for b in boards]
    if pixels and previous is not None:
        motion = _median_motion(gray, _reduced(previous, reduction), max(pixels, key=len)) * float(scale.max())
    if reduction > 1:
        grids = tuple(replace(grid.resized(scale), blur=grid.blur) for grid in grids)
        boards = tuple(b.resized(scale) for b in boards)
    return _Searched(candidate.frame.index, grids, boards, motion)


def _thumbnail(gray: Gray) -> Gray:
    return _reduced(gray, max(gray.shape[1] / THUMBNAIL_WIDTH_PX, 1.0))


def _reduced(gray: Gray, factor: float) -> Gray:
    import cv2

    if factor <= 1:
        return gray
    height, width = gray.shape
    size = max(1, round(width / factor)), max(1, round(height / factor))
    return np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_AREA), np.uint8)


def _score(gray: Gray, thumbnail: Gray, previous: Gray | None) -> float:
    """Return how sharp and still a frame is, relative to its neighbours."""
    import cv2

    sharpness = cv2.norm(cv2.Laplacian(gray, cv2.CV_16S)) ** 2 / gray.size
    if previous is None:
        return -1.0 / (1 + sharpness)  # unknown motion: worse than any other
    # Brightness changes by motion times slope (Horn and Schunck, 1981): the ratio of the sums is a motion in px.
    slope = sum(cv2.norm(cv2.Sobel(thumbnail, cv2.CV_16S, *order), cv2.NORM_L1) for order in ((1, 0), (0, 1))) / 8
    motion = cv2.norm(thumbnail, previous, cv2.NORM_L1) / (slope + 1)
    return float(sharpness / (1 + motion**2))


def _median_motion(gray: Gray, previous: Gray, pixels: NDArray[np.float64]) -> float:
    """Return the median motion of points between two frames, px, by the tracker of Lucas and Kanade."""
    import cv2

    start = pixels.astype(np.float32)[:, None]
    end, tracked, _ = cv2.calcOpticalFlowPyrLK(gray, previous, start, np.empty_like(start))
    moved = np.linalg.norm(end - start, axis=2)[tracked == 1]
    return float(np.median(moved)) if len(moved) else 0.0
