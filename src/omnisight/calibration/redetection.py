"""Looking again, with a first calibration: where every corner must be, and how edges bend there, is known then."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import State
from omnisight.camera import Camera
from omnisight.geometry.rotation import look
from omnisight.geometry.sphere import angle_from_axis
from omnisight.images import UnreadableImage, read_image, to_gray8
from omnisight.models import CameraModel
from omnisight.targets import Board, Checkerboard, Detection, Detections, ImageDetection
from omnisight.targets.detection_limits import MIN_EXPLAINED, MIN_RELATIVE_CONTRAST
from omnisight.targets.detectors import measure
from omnisight.targets.detectors.checkerboard.board_assignment import assign_to_board
from omnisight.targets.detectors.checkerboard.grid_search import as_grid, find_grids
from omnisight.targets.detectors.checkerboard.lattice_completion import drop_false_corners
from omnisight.targets.detectors.checkerboard.measured_lattice import MeasuredLattice
from omnisight.targets.observations import Observations
from omnisight.views import perspective, remap

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]

FAR_DEG = 80.0
# Steps of the board's points, over their reach, between which the image's steps and bends are taken.
SPAN = 0.4
# A corner that is measured this share of a step off where the first calibration puts it is another point; one that was
# found before may be this many times as far off in px: it is for the robust loss to judge.
STRAY, LENIENT = 0.2, 3.0
# Flat views in which a board that was missed is looked for: (angle from the axis, how many around it), degrees.
VIEWS = ((0, 1), (50, 6), (90, 8), (120, 8))
VIEW_DEG, VIEW_PX = 90.0, 800
# Images in a row that flat views were of no use for, after which the others are not tried.
PATIENCE = 6
# Part of a board's corners that the second look may miss before the board as a whole is doubted.
CONTRADICTED = 0.5
# What two edges may leave unexplained at a corner that the first look did not find: so much, and so many times as much
# as at those that it found. Where a board ends three edges meet, and a sixth or more is left.
POORER = 0.05, 3.0
# Places of a part of a board that are tried: a small part of a large board has hundreds, and is little worth.
MOST_PLACES = 40
# A point less sure than this, px, says nothing.
VAGUE = 2.0


@dataclass(frozen=True)
class RedetectionStats:
    """What the second look brought.

    Attributes
    ----------
    corners, far
        Corners that the first look had not found, and those of them beyond 80 degrees from the axis.
    dropped
        Corners of the first look that the second does not confirm.
    boards
        Boards found only in rectified views.
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
        said = f"second look: +{self.corners} corners, {self.far} of them beyond {FAR_DEG:.0f} degrees"
        said += f", +{self.boards} boards" if self.boards else ""
        return said + (f", {self.dropped} not confirmed" if self.dropped else "")


def redetect(
    search: Detections,
    views: Observations,
    state: State,
    *,
    apply_exif: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Detections, RedetectionStats]:
    """Measure every corner again where a calibration puts it.

    A corner's window then follows the board through the lens: its edges run, turn and bend as the camera says. Corners
    that were missed are looked for there. Images without a board are searched in flat views, each a camera of its
    own, where a lens bends nothing.

    Parameters
    ----------
    search, views
        The first look, and `Observations.of_search` of it.
    state
        A camera and the poses of those boards.
    apply_exif
        As the images were read before.
    progress
        Called with (images done, images in all) after each.
    """
    board = search.board
    if not isinstance(board, Board):  # none, or one whose corners were given
        return search, RedetectionStats()
    gate = ResidualWeights.estimate(state, views).threshold
    first = np.concatenate([[0], np.cumsum([len(p.boards) for p in search.images])])
    camera = Camera(state.model, search.size)

    fruitless = [0]  # images without a board in which flat views showed none either

    def again(i: int) -> tuple[ImageDetection, RedetectionStats]:
        picture = search.images[i]
        if picture.size is None or (not picture.boards and fruitless[0] >= PATIENCE):
            return picture, RedetectionStats()
        try:
            gray = to_gray8(read_image(picture.path, apply_exif=apply_exif))
        except UnreadableImage:  # it was read before: what was found then stays
            return picture, RedetectionStats()
        if not picture.boards:
            found = _in_flat_views(gray, camera, board)
            fruitless[0] = 0 if found else fruitless[0] + 1
            if not found:
                return picture, RedetectionStats()
            better = picture.with_boards(found, board).with_remark("found in a rectified view")
            far = camera.angle_of(found[0].pixels) > np.radians(FAR_DEG)
            return better, RedetectionStats(len(found[0]), int(far.sum()), 0, 1)
        won, boards = RedetectionStats(), list[Detection]()
        for k, detection in enumerate(picture.boards):
            pose = state.rotations[first[i] + k], state.translations[first[i] + k]
            measured, more = _settled(gray, board, detection, state.model, pose, gate)
            won += more
            if more.dropped <= CONTRADICTED * len(detection):
                boards.append(measured)
        better = picture.with_boards(boards, board)
        if len(boards) < len(picture.boards):
            better = better.with_remark("a board left out: it is not where the others say the camera sees it")
        return better, won

    pictures, total = list[ImageDetection](), RedetectionStats()
    with ThreadPoolExecutor(max_workers=min(8, os.cpu_count() or 1)) as pool:
        for picture, won in pool.map(again, range(len(search.images))):
            pictures.append(picture)
            total += won
            if progress is not None:
                progress(len(pictures), len(search.images))
    return replace(search, images=pictures), total


def _again(
    gray: Bytes,
    board: Board,
    detection: Detection,
    model: CameraModel,
    cam_from_board: tuple[Array, Array],
    gate: float,
) -> tuple[Detection, RedetectionStats]:
    """Measure the points of a board whose pose is known."""
    rotation, translation = cam_from_board

    def project(points: Array) -> Array:
        pixels, valid = model.project_numpy(points @ rotation.T + translation)
        return np.where(valid[:, None], pixels, np.nan)

    shift = SPAN * board.window_step * np.array([[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    seen = project((board.points[:, None] + shift).reshape(-1, 3)).reshape(-1, 5, 2)
    there = seen[:, 0]
    steps = np.stack([seen[:, 1] - seen[:, 2], seen[:, 3] - seen[:, 4]], 1) / (2 * SPAN)
    bends = np.stack([seen[:, 1] + seen[:, 2], seen[:, 3] + seen[:, 4]], 1) / 2 - there[:, None]
    start = there.copy()
    start[detection.ids] = detection.pixels
    found = measure(gray, board, start, steps, bends / SPAN**2)
    pixels = found.pixels - board.measurement_offset(project)
    off = np.linalg.norm(pixels - there, axis=1)
    step = np.linalg.norm(steps, axis=-1).min(1)
    room, more = np.minimum(max(gate, 1.0), STRAY * step), np.minimum(LENIENT * max(gate, 1.0), STRAY * step)
    known = np.zeros(board.size, bool)
    known[detection.ids] = True
    left = 1 - found.explained
    usual = np.nanmedian(left[known]) if np.isfinite(left[known]).any() else 0.0
    most = np.where(known, 1 - MIN_EXPLAINED, min(POORER[0] + POORER[1] * usual, 1 - MIN_EXPLAINED))
    clear = (left < most) & (np.trace(found.covariance, axis1=1, axis2=2) < VAGUE**2)
    contrast = found.amplitude if board.bright_ahead is None else np.where(board.bright_ahead, found.amplitude, -found.amplitude)
    level = np.nanmedian(contrast[known]) if np.isfinite(contrast[known]).any() else np.nan
    clear &= contrast * np.sign(level) > MIN_RELATIVE_CONTRAST * abs(level)  # the other way round in a mirror
    good = clear & (off < np.where(known, more, room))
    ids = np.flatnonzero(good)
    new = good & ~known
    directions = board.points @ rotation.T + translation
    angle = np.degrees(angle_from_axis(directions))
    won = RedetectionStats(int(new.sum()), int((new & (angle > FAR_DEG)).sum()), int((known & ~good).sum()))
    return replace(detection, ids=ids, pixels=pixels[ids], covariance=found.covariance[ids]), won


def _settled(
    gray: Bytes,
    board: Board,
    detection: Detection,
    model: CameraModel,
    cam_from_board: tuple[Array, Array],
    gate: float,
) -> tuple[Detection, RedetectionStats]:
    """Measure the points of a board; where its place on the lattice is open, at every place, and keep the best.

    The best is the one at which most of the board is there. It is sure if it alone reaches to all four ends.
    """
    if not isinstance(board, Checkerboard) or detection.located or _places(detection, board) > MOST_PLACES:
        return _again(gray, board, detection, model, cam_from_board, gate)
    rotation, translation = cam_from_board
    diagonal, last = board.points[board.columns + 1], board.points[-1]
    poses = [(detection.ids, rotation, translation)]
    if not board.is_symmetric:  # else half a turn changes nothing
        poses.append((board.size - 1 - detection.ids, rotation * (-1, -1, 1), translation + rotation @ last))
    tries: list[tuple[Detection, RedetectionStats]] = []
    for half, (ids, turned, origin) in enumerate(poses):
        order = np.argsort(ids)
        ordered = replace(
            detection, ids=ids[order], pixels=detection.pixels[order], covariance=detection.covariance[order]
        )
        j, i = np.divmod(ids, board.columns)
        for down in range(-int(j.min()), board.rows - int(j.max())):
            for right in range(-int(i.min()), board.columns - int(i.max())):
                if board.is_symmetric or (down + right) % 2 == half:  # the colours agree
                    shifted = replace(ordered, ids=ordered.ids + down * board.columns + right)
                    pose = turned, origin - turned @ (np.array([right, down, 0]) * diagonal)
                    tries.append(_again(gray, board, shifted, model, pose, gate))
    tries.sort(key=lambda found: len(found[0]), reverse=True)
    best, won = tries[0]
    alone = len(tries) == 1 or len(tries[1][0]) < len(best)
    j, i = np.divmod(best.ids, board.columns)
    spans = (i.min(), i.max(), j.min(), j.max()) == (0, board.columns - 1, 0, board.rows - 1)
    return replace(best, located=bool(alone and spans)), won


def _places(detection: Detection, board: Checkerboard) -> int:
    """Count the places on the lattice that a part of a board may have, upright."""
    j, i = np.divmod(detection.ids, board.columns)
    return int((board.columns - np.ptp(i)) * (board.rows - np.ptp(j)))


def _in_flat_views(gray: Bytes, camera: Camera, board: Board) -> list[Detection]:
    """Look for a board in flat views of an image that shows none as it is."""
    best: list[Detection] = []
    if not isinstance(board, Checkerboard):
        return best
    for target, rotation in _flat_views(camera):
        view = np.asarray(remap(gray, camera, target, rotation), np.uint8)
        for grid in find_grids(view):
            bearings, _ = target.unproject(grid.pixels)
            pixels, valid = camera.project(bearings @ rotation)
            lattice = np.where(valid[..., None], pixels, np.nan)
            measured = MeasuredLattice.empty(lattice.shape)
            measured.measure(gray, lattice, grid.present)
            drop_false_corners(gray, measured)
            found = as_grid(gray, measured)
            placed = None if found is None else assign_to_board(found, board)
            if placed is not None and (not best or len(placed) > len(best[0])):
                best = [placed]
        if best and len(best[0]) == board.size:
            break
    return best


def _flat_views(camera: Camera) -> Iterator[tuple[Camera, Array]]:
    reach = np.degrees(camera.image_theta_max())
    target = perspective(VIEW_DEG, (VIEW_PX, VIEW_PX))
    for angle, count in VIEWS:
        if angle - VIEW_DEG / 2 > reach:
            return
        for k in range(count):
            yield target, look(pitch=angle) @ look(roll=k * 360 / count)
