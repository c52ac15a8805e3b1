"""Re-detection: measure corners again where a first camera predicts them, and search for missed ones there."""

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import State
from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.geometry.rotation import look
from omnisight.geometry.sphere import angle_from_axis
from omnisight.images import UnreadableImage, read_image, to_gray8
from omnisight.images.interlacing import deinterlace
from omnisight.models import CameraModel
from omnisight.progress import Progress, no_progress
from omnisight.targets import Board, Checkerboard, Detection, Detections, ImageDetection
from omnisight.targets.detection_limits import MIN_EXPLAINED, MIN_RELATIVE_CONTRAST
from omnisight.targets.detectors import measure
from omnisight.targets.detectors.checkerboard.board_assignment import assign_to_board
from omnisight.targets.detectors.checkerboard.grid_search import as_grid, find_grids
from omnisight.targets.detectors.checkerboard.lattice_completion import drop_false_corners
from omnisight.targets.detectors.checkerboard.measured_lattice import MeasuredLattice
from omnisight.targets.observation_checks import are_collinear
from omnisight.targets.observations import Observations
from omnisight.views import perspective, remap

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]

# Off-axis angle (degrees) from which new corners are counted separately.
FAR_DEG = 80.0
# Steps between board points, in window steps, over which the pixel steps and bends are differentiated.
DIFFERENCE_STEP = 0.4
# Distance from the predicted pixel, in pixel steps, above which a measured corner is another one.
MAX_STEP_SHARE = 0.2
# Least distance (px) from the prediction that is accepted; known corners may be `KNOWN_FACTOR` times as far.
MIN_GATE_PX, KNOWN_FACTOR = 1.0, 3.0
# Perspective views in which missed boards are searched: (off-axis angle in degrees, number of views around the axis).
VIEW_DIRECTIONS = ((0, 1), (50, 6), (90, 8), (120, 8))
VIEW_FOV_DEG, VIEW_SIZE_PX = 90.0, 800
# Images searched in these views at a time; after as many without success the remaining ones are skipped.
MAX_FAILURES = 6
# Share of unconfirmed corners above which a board is rejected.
MAX_UNCONFIRMED_SHARE = 0.5
# Unexplained share of the intensity at a new corner: an absolute allowance plus a multiple of that at known corners.
# Where a board ends, three edges meet, and a sixth or more remains unexplained.
UNEXPLAINED_ALLOWANCE, UNEXPLAINED_FACTOR = 0.05, 3.0
# Positions of a partial board that are tried: a small part of a large board has hundreds, and contributes little.
MAX_POSITIONS = 40
# Standard deviation (px) above which a corner carries no information.
MAX_SIGMA_PX = 2.0


@dataclass(frozen=True)
class RedetectionStats(Displayed):
    """What the re-detection pass added and removed.

    Attributes
    ----------
    corners, far
        New corners, and those of them beyond 80° off-axis.
    dropped
        Corners of the first pass that were not confirmed.
    boards
        Boards detected only in perspective views.
    """

    corners: int = 0
    far: int = 0
    dropped: int = 0
    boards: int = 0

    def __add__(self, other: "RedetectionStats") -> "RedetectionStats":
        return RedetectionStats(
            self.corners + other.corners,
            self.far + other.far,
            self.dropped + other.dropped,
            self.boards + other.boards,
        )

    def __str__(self) -> str:
        parts = [f"+{self.corners} corners ({self.far} beyond {FAR_DEG:.0f}° off-axis)"]
        parts += [f"+{self.boards} boards"] * bool(self.boards)
        parts += [f"{self.dropped} not confirmed"] * bool(self.dropped)
        return ", ".join(parts)


@dataclass(frozen=True)
class _PredictedBoard:
    """A board, the camera and the pose that predict its pixels, and how far (px) a measurement may be from them."""

    board: Board
    model: CameraModel
    rotation: Array
    translation: Array
    gate: float

    def project(self, points: Array) -> Array:
        """Return the pixels (N, 2) of board points (N, 3), NaN outside the model's domain."""
        return self.model.project_numpy(points @ self.rotation.T + self.translation)[0]

    def off_axis_deg(self) -> Array:
        """Return the angle (N,) of the board points from the axis, degrees."""
        return np.degrees(angle_from_axis(self.board.points @ self.rotation.T + self.translation))


def redetect(
    observations: Observations,
    initial: State,
    *,
    apply_exif: bool = False,
    progress: Progress = no_progress,
) -> tuple[Observations, RedetectionStats]:
    """Measure every corner again where a first camera predicts it, and search for missed ones.

    The window of a corner then follows the board through the lens: its edges have the predicted directions and
    curvatures. Images without a board are searched in perspective views, which have no distortion.

    Parameters
    ----------
    observations
        The first detections; returned unchanged if they do not come from images.
    initial
        A camera and the poses of their boards.
    apply_exif
        As in the first detection.
    progress
        Called with (stage, done, total) after each image.
    """
    detections = observations.detections
    if detections is None or not isinstance(detections.board, Board):
        return observations, RedetectionStats()
    search = _ImageSearch(detections, initial, ResidualWeights.estimate(initial, observations).threshold, apply_exif)
    images, total, done = list(detections.images), RedetectionStats(), 0
    with ThreadPoolExecutor(max_workers=min(8, os.cpu_count() or 1)) as pool:
        for batch in _batches(images):
            boards = 0
            for index, (image, stats) in zip(batch, pool.map(search, batch), strict=True):
                images[index] = image
                total += stats
                boards += stats.boards
                done += 1
                progress("re-detect", done, len(images))
            if not detections.images[batch[0]].boards and not boards:
                break
    if done < len(images):
        progress("re-detect", len(images), len(images))
    return Observations.from_detections(replace(detections, images=images), observations.image_names), total


def _batches(images: Sequence[ImageDetection]) -> Iterator[list[int]]:
    """Yield the indices of the images with a board, then those of the others, a few at a time."""
    if found := [i for i, image in enumerate(images) if image.boards]:
        yield found
    others = [i for i, image in enumerate(images) if image.size is not None and not image.boards]
    yield from (others[start : start + MAX_FAILURES] for start in range(0, len(others), MAX_FAILURES))


class _ImageSearch:
    """Re-detection in one image."""

    def __init__(self, detections: Detections, initial: State, gate: float, apply_exif: bool) -> None:
        assert isinstance(detections.board, Board)
        self.detections, self.initial, self.gate, self.apply_exif = detections, initial, gate, apply_exif
        self.board, self.camera = detections.board, Camera(initial.central_model, detections.size)
        self.first_view = np.concatenate([[0], np.cumsum([len(image.boards) for image in detections.images])])

    def __call__(self, index: int) -> tuple[ImageDetection, RedetectionStats]:
        image = self.detections.images[index]
        try:
            gray = deinterlace(to_gray8(read_image(image.path, apply_exif=self.apply_exif)))
        except UnreadableImage:  # it was readable before: keep the first detection
            return image, RedetectionStats()
        return self._measure_again(gray, image, index) if image.boards else self._search_views(gray, image)

    def _measure_again(self, gray: Bytes, image: ImageDetection, index: int) -> tuple[ImageDetection, RedetectionStats]:
        total, boards = RedetectionStats(), list[Detection]()
        for k, detection in enumerate(image.boards):
            view = self.first_view[index] + k
            pose = self.initial.rotations[view], self.initial.translations[view]
            predicted = _PredictedBoard(self.board, self.camera.model, *pose, self.gate)
            measured, stats = _locate_and_measure(gray, predicted, detection)
            total += stats
            is_confirmed = stats.dropped <= MAX_UNCONFIRMED_SHARE * len(detection)
            if is_confirmed and not are_collinear(self.board.points[measured.ids], measured.pixels):
                boards.append(measured)
        result = image.with_boards(boards, self.board)
        if len(boards) < len(image.boards):
            result = result.with_remark("a board left out: it is not where the camera of the other images predicts it")
        return result, total

    def _search_views(self, gray: Bytes, image: ImageDetection) -> tuple[ImageDetection, RedetectionStats]:
        found = _detect_in_views(gray, self.camera, self.board)
        if found is None:
            return image, RedetectionStats()
        angles = angle_from_axis(self.camera.model.unproject_numpy(found.pixels)[0])
        far = int((angles > np.radians(FAR_DEG)).sum())
        result = image.with_boards([found], self.board).with_remark("detected in a perspective view")
        return result, RedetectionStats(len(found), far, 0, 1)


def _measure(gray: Bytes, predicted: _PredictedBoard, detection: Detection) -> tuple[Detection, RedetectionStats]:
    """Measure all points of a board near their predicted pixels."""
    board = predicted.board
    shift = DIFFERENCE_STEP * board.window_step
    shifts = shift * np.array([[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    stencil = predicted.project((board.points[:, None] + shifts).reshape(-1, 3)).reshape(-1, 5, 2)
    expected = stencil[:, 0]
    steps = np.stack([stencil[:, 1] - stencil[:, 2], stencil[:, 3] - stencil[:, 4]], 1) / (2 * DIFFERENCE_STEP)
    bends = np.stack([stencil[:, 1] + stencil[:, 2], stencil[:, 3] + stencil[:, 4]], 1) / 2 - expected[:, None]
    start = expected.copy()
    start[detection.ids] = detection.pixels
    fits = measure(gray, board, start, steps, bends / DIFFERENCE_STEP**2)
    pixels = fits.pixels - board.measurement_offset(predicted.project)
    known = np.zeros(board.size, bool)
    known[detection.ids] = True

    unexplained = 1 - fits.explained
    usual = np.nanmedian(unexplained[known]) if np.isfinite(unexplained[known]).any() else 0.0
    limit_new = min(UNEXPLAINED_ALLOWANCE + UNEXPLAINED_FACTOR * usual, 1 - MIN_EXPLAINED)
    clear = unexplained < np.where(known, 1 - MIN_EXPLAINED, limit_new)
    clear &= np.trace(fits.covariance, axis1=1, axis2=2) < MAX_SIGMA_PX**2
    bright = board.bright_ahead
    contrast = fits.amplitude if bright is None else np.where(bright, fits.amplitude, -fits.amplitude)
    level = np.nanmedian(contrast[known]) if np.isfinite(contrast[known]).any() else np.nan
    clear &= contrast * np.sign(level) > MIN_RELATIVE_CONTRAST * abs(level)  # negative in a mirror

    gate = max(predicted.gate, MIN_GATE_PX) * np.where(known, KNOWN_FACTOR, 1.0)
    near = MAX_STEP_SHARE * np.linalg.norm(steps, axis=-1).min(1)
    confirmed = clear & (np.linalg.norm(pixels - expected, axis=1) < np.minimum(gate, near))
    ids, new = np.flatnonzero(confirmed), confirmed & ~known
    far = new & (predicted.off_axis_deg() > FAR_DEG)
    stats = RedetectionStats(int(new.sum()), int(far.sum()), int((known & ~confirmed).sum()))
    return replace(detection, ids=ids, pixels=pixels[ids], covariance=fits.covariance[ids]), stats


def _locate_and_measure(
    gray: Bytes, predicted: _PredictedBoard, detection: Detection
) -> tuple[Detection, RedetectionStats]:
    """Measure the points of a board; if its position is ambiguous, at every position, and keep that with most points.

    The position is unique if it alone reaches all four borders of the board.
    """
    board = predicted.board
    if not isinstance(board, Checkerboard) or detection.located or _position_count(detection, board) > MAX_POSITIONS:
        return _measure(gray, predicted, detection)
    tries = [
        _measure(gray, replace(predicted, rotation=rotation, translation=translation), moved)
        for moved, rotation, translation in _positions(predicted, board, detection)
    ]
    tries.sort(key=lambda result: len(result[0]), reverse=True)
    best, stats = tries[0]
    is_unique = len(tries) == 1 or len(tries[1][0]) < len(best)
    j, i = np.divmod(best.ids, board.columns)
    reaches_borders = (i.min(), i.max(), j.min(), j.max()) == (0, board.columns - 1, 0, board.rows - 1)
    return replace(best, located=bool(is_unique and reaches_borders)), stats


def _positions(
    predicted: _PredictedBoard, board: Checkerboard, detection: Detection
) -> Iterator[tuple[Detection, Array, Array]]:
    """Yield the detection at every position on the board that its colours allow, with the pose of the board."""
    rotation, translation = predicted.rotation, predicted.translation
    diagonal, last = board.points[board.columns + 1], board.points[-1]
    poses = [(detection.ids, rotation, translation)]
    if not board.is_symmetric:  # half a turn is another position
        poses.append((board.size - 1 - detection.ids, rotation * (-1, -1, 1), translation + rotation @ last))
    for half_turn, (ids, turned, origin) in enumerate(poses):
        order = np.argsort(ids)
        j, i = np.divmod(ids, board.columns)
        for down in range(-int(j.min()), board.rows - int(j.max())):
            for right in range(-int(i.min()), board.columns - int(i.max())):
                if board.is_symmetric or (down + right) % 2 == half_turn:
                    moved = replace(
                        detection,
                        ids=ids[order] + down * board.columns + right,
                        pixels=detection.pixels[order],
                        covariance=detection.covariance[order],
                    )
                    yield moved, turned, origin - turned @ (np.array([right, down, 0]) * diagonal)


def _position_count(detection: Detection, board: Checkerboard) -> int:
    """Return the number of positions of a partial board on the lattice, without half turns."""
    j, i = np.divmod(detection.ids, board.columns)
    return int((board.columns - np.ptp(i)) * (board.rows - np.ptp(j)))


def _detect_in_views(gray: Bytes, camera: Camera, board: Board) -> Detection | None:
    """Detect a checkerboard in perspective views of an image."""
    best: Detection | None = None
    if not isinstance(board, Checkerboard):
        return best
    for target, rotation in _perspective_views(camera):
        view = np.asarray(remap(gray, camera, target, rotation), np.uint8)
        for grid in find_grids(view):
            bearings, _ = target.unproject(grid.pixels)
            pixels, valid = camera.project(bearings @ rotation)
            lattice = np.where(valid[..., None], pixels, np.nan)
            measured = MeasuredLattice.empty(lattice.shape)
            measured.measure(gray, lattice, grid.present)
            drop_false_corners(gray, measured)
            found = as_grid(gray, measured)
            assigned = None if found is None else assign_to_board(found, board)
            if assigned is not None and (best is None or len(assigned) > len(best)):
                best = assigned
        if best is not None and len(best) == board.size:
            break
    return best


def _perspective_views(camera: Camera) -> Iterator[tuple[Camera, Array]]:
    """Yield perspective cameras and their rotations that cover the field of view."""
    reach = np.degrees(camera.image_theta_max())
    target = perspective((VIEW_SIZE_PX, VIEW_SIZE_PX), VIEW_FOV_DEG)
    for angle, count in VIEW_DIRECTIONS:
        if angle - VIEW_FOV_DEG / 2 > reach:
            return
        for k in range(count):
            yield target, look(pitch=angle) @ look(roll=k * 360 / count)
