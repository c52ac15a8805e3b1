"""Check the size of the markers of a board relative to the distance between them."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.state import State
from omnisight.quality.checks.held_out_error import MAX_HELD_OUT_PX, NEGLIGIBLE_PX
from omnisight.quality.evidence import Check, Evidence
from omnisight.targets.boards.aprilgrid import AprilGrid
from omnisight.targets.boards.aruco_grid import ArucoGrid
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

PRIORITY = 1

# Relative change of the size at which the pixels are differentiated.
DIFFERENCE_STEP = 1e-3
# Share of the squared residuals that another size explains: from a half, it is the main cause of the residuals.
MIN_EXPLAINED_SHARE = 0.5


def check(evidence: Evidence) -> Check:
    """Check that markers of another size, about the same centres, do not explain the residuals."""
    passed = Check("marker spacing")
    detections = evidence.observations.detections
    board = None if detections is None else detections.board
    if not isinstance(board, AprilGrid | ArucoGrid):
        return passed
    inliers = evidence.observations.at(np.flatnonzero(~evidence.outliers))
    growth, rms, share = marker_growth(evidence.candidate.state, inliers, board)
    level = evidence.grade(rms, (NEGLIGIBLE_PX, MAX_HELD_OUT_PX[0]))
    if share < MIN_EXPLAINED_SHARE or not level:
        return passed
    side = board.tag if isinstance(board, AprilGrid) else board.marker
    assumed, actual = board.pitch / side - 1, board.pitch / (side * (1 + growth)) - 1
    return Check(
        passed.name,
        level,
        f"The gap between two markers is {actual:.3f} of the side of a marker, not {assumed:.3g} as specified. The"
        f" difference explains {100 * share:.0f} % of the squared residuals: measure the markers, and correct the"
        f" {'spacing' if isinstance(board, AprilGrid) else 'separation'} of the board.",
    )


def marker_growth(state: State, observations: Observations, board: AprilGrid | ArucoGrid) -> tuple[float, float, float]:
    """Return the relative growth of the markers that explains the residuals best.

    Returns
    -------
    growth
        Of the side of each marker about its centre, in units of the side.
    rms
        Of the displacements of the corners that it explains, px.
    share
        Share of the squared residuals that it explains.
    """
    from scipy.spatial import KDTree  # imported on use: scipy is slow to import

    corners = board.points.reshape(-1, 4, 3) if isinstance(board, ArucoGrid) else board.points[board.corners]
    centres = corners.mean(axis=1)
    # The corners of a marker are nearer to its centre than to that of any other.
    outward = observations.points - centres[KDTree(centres).query(observations.points)[1]]
    residuals = state.residuals(observations)
    middle = board.points.mean(axis=0)
    slope, scale = (
        (state.residuals(replace(observations, points=observations.points + DIFFERENCE_STEP * step)) - residuals)
        / DIFFERENCE_STEP
        for step in (outward, observations.points - middle)
    )
    known = np.isfinite(slope + scale).all(axis=1)
    slope, scale, residuals = slope[known], scale[known], residuals[known]
    # The distances of the boards have absorbed the mean change of scale.
    slope = slope - scale * (slope * scale).sum() / max((scale**2).sum(), 1e-12)
    growth = -float((slope * residuals).sum() / max((slope**2).sum(), 1e-12))
    explained = growth**2 * float((slope**2).sum())
    return growth, np.sqrt(explained / max(len(slope), 1)), explained / max(float((residuals**2).sum()), 1e-12)
