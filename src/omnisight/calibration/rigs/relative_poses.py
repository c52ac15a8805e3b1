"""Relative pose of two cameras from the boards that both observe, robust to wrong frames and to half turns."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.rigs.observations import RigPart
from omnisight.calibration.rigs.poses import Poses
from omnisight.calibration.state import State
from omnisight.geometry.pose import Pose
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.intp]
Pair = tuple[int, int]

# Share of the simultaneous views that must agree on a relative pose: below, the views are not simultaneous, or the
# cameras moved. A third leaves room for a camera that moved in the middle of the images.
MIN_AGREEING_SHARE = 1 / 3
# Ratio of the residual of a view to that of the agreeing share above which it contradicts the relative pose.
MAX_RESIDUAL_RATIO = 5.0
# Residuals (px, relative to an image 1000 px wide) below which a view never contradicts, because the pose of one board
# has this error in another camera, and above which it always does.
MIN_RESIDUAL_PX, MAX_RESIDUAL_PX = 2.0, 30.0
# Frames from which relative poses are proposed, evenly spread; each is tried on all frames.
MAX_PROPOSALS = 40
# Corners of a board that are projected to compare relative poses.
COMPARED_CORNERS = 12


@dataclass(frozen=True, eq=False)
class RelativePose:
    """The relative pose of two cameras.

    Attributes
    ----------
    b_from_a
        The pose.
    groups
        (F,) simultaneous groups, ascending.
    agrees
        (F,) whether each agrees with the pose.
    turned
        (F,) whether the board of camera b is half a turn from that of camera a, which looks the same.
    residual_px
        (F,) median distance (px) in camera b of the board as posed by camera a from where camera b observed it.
    """

    b_from_a: Pose
    groups: Indices
    agrees: Bools
    turned: Bools
    residual_px: Array

    @property
    def support(self) -> int:
        """Number of groups that agree."""
        return int(self.agrees.sum())


def estimate_relative_pose(
    part_a: RigPart, state_a: State, part_b: RigPart, state_b: State, *, is_symmetric: bool
) -> RelativePose | None:
    """Estimate the relative pose of two cameras from simultaneous views of a board; None if there are none.

    Every simultaneous view proposes cam_b_from_board @ board_from_cam_a, for a symmetric board also with half a turn in
    between. The proposal with the lowest residual of the best third of all views is selected: least quantile of
    squares (Rousseeuw and Leroy, Robust Regression and Outlier Detection, 1987).

    Parameters
    ----------
    part_a, part_b
        Views of the same board by both cameras.
    state_a, state_b
        Their cameras and poses.
    is_symmetric
        Whether the board looks the same after half a turn.
    """
    groups, at_a, at_b = np.intersect1d(part_a.group, part_b.group, return_indices=True)
    if not len(groups):
        return None
    a_from_board, b_from_board = _poses(state_a)[at_a], _poses(state_b)[at_b]
    turns = [Pose()] + ([half_turn(part_b.observations)] if is_symmetric else [])
    corners = _Corners.of(part_b.observations, at_b)
    proposed = np.unique(np.linspace(0, len(groups) - 1, MAX_PROPOSALS).round().astype(np.intp))
    quantile = max(int(np.ceil(MIN_AGREEING_SHARE * len(groups))) - 1, 0)
    best: tuple[float, Pose, Array] | None = None
    for turn in turns:
        proposals = b_from_board[proposed] @ Poses.of(turn) @ a_from_board[proposed].inverse()
        for k in range(len(proposals)):
            pose = proposals.one(k)
            residuals = np.stack([corners.residuals(state_b, Poses.of(pose) @ a_from_board, t) for t in turns])
            # A view that is compared with the pose it proposed has no residual.
            others = np.delete(residuals.min(0), proposed[k]) if len(groups) > 1 else residuals.min(0)
            score = float(np.partition(others, min(quantile, len(others) - 1))[min(quantile, len(others) - 1)])
            if best is None or score < best[0]:
                best = score, pose, residuals
    assert best is not None
    score, pose, residuals = best
    scale = max(part_b.observations.size) / 1000
    allowed = scale * np.clip(MAX_RESIDUAL_RATIO * score / scale, MIN_RESIDUAL_PX, MAX_RESIDUAL_PX)
    least = residuals.min(0)
    return RelativePose(pose, groups, least <= allowed, residuals.argmin(0) == 1, least)


def half_turn(observations: Observations) -> Pose:
    """Return the half turn of a symmetric board about its middle."""
    middle = observations.extent.mean(0)
    return Pose(np.diag([-1.0, -1.0, 1.0]), np.array([2 * middle[0], 2 * middle[1], 0.0]))


def turned(observations: Observations, views: Bools) -> Observations:
    """Return the observations with the boards of some views (V,) numbered from the opposite corner."""
    turn = half_turn(observations)
    rows = views[observations.view_of_row]
    return replace(observations, points=np.where(rows[:, None], turn @ observations.points, observations.points))


@dataclass(frozen=True, eq=False)
class _Corners:
    """A few corners of each view: board points (F, K, 3) and pixels (F, K, 2)."""

    points: Array
    pixels: Array

    @classmethod
    def of(cls, observations: Observations, views: Indices) -> "_Corners":
        rows = [
            np.linspace(group.start, group.stop - 1, COMPARED_CORNERS).round().astype(np.intp)
            for group in (observations.groups[v] for v in views)
        ]
        return cls(observations.points[rows], observations.pixels[rows])

    def residuals(self, state: State, poses: Poses, turn: Pose) -> Array:
        """Return the median distance (F,), px, of the corners from their pixels; inf where none projects."""
        at = (turn @ self.points) @ np.swapaxes(poses.rotation, 1, 2) + poses.translation[:, None]
        pixels, valid = state.model.project_numpy(at.reshape(-1, 3))
        distance = np.linalg.norm(pixels.reshape(self.pixels.shape) - self.pixels, axis=-1)
        return np.median(np.where(valid.reshape(distance.shape), distance, np.inf), axis=1)


def _poses(state: State) -> Poses:
    return Poses(state.rotations, state.translations)
