"""Choice of the board to hold for the next image, given the target of the images so far."""

from dataclasses import replace

import numpy as np

from omnisight.targets import Board, Checkerboard, PointTarget
from omnisight.targets.boards.checkerboard import MIN_CORNERS
from omnisight.targets.observations import Observations


def choose_board(
    observations: Observations, requested: Board | None, default: Board | None = None
) -> tuple[Observations, Board]:
    """Return the board to hold, and the observations with their points in that board's frame.

    A detected board is held again. Given points of a plane determine its warp, so the same board is held: the
    requested or default one, or a checkerboard of the same size with as many corners. Points of a rigid body determine
    only the camera, so any flat board may be held.

    Parameters
    ----------
    observations
        Observations of the images so far.
    requested
        Board specified by the user; its unit must be that of the observations.
    default
        Board of the camera's calibration; ignored if its unit differs.

    Raises
    ------
    ValueError
        If the points are those of a rigid body and no board is given, or the unit of the requested board differs.
    """
    target = None if observations.detections is None else observations.detections.board
    if target is not None and not isinstance(target, PointTarget):
        return observations, target
    if target is None:
        target = PointTarget(np.unique(observations.points, axis=0), observations.unit)
    board = requested or default
    if target.points[:, 2].any():
        if board is None:
            raise ValueError(
                f"the board to hold is unknown, because the corners are of {target}: specify a flat board for the next"
                " image with --pattern, such as 9x6, or --target"
            )
        return observations, board
    if requested is not None and requested.unit != target.unit:
        raise ValueError(
            f"the corners are in {target.unit}, but the size of {requested} in {target.unit} is not known: specify"
            " --pattern, such as 9x6, instead"
        )
    if board is None or board.unit != target.unit:
        board = _checkerboard_of_same_size(target)
    offset = target.points.min(0) - board.points.min(0)
    points, extent = observations.points - offset, observations.extent - offset[:2]
    return replace(observations, points=points, extent=extent), board


def _checkerboard_of_same_size(target: PointTarget) -> Checkerboard:
    """Return the checkerboard whose inner corners the points are, or one as large with about as many corners."""
    from scipy.spatial import KDTree

    nearest, _ = KDTree(target.points).query(target.points, k=2)
    sides = np.ptp(target.points[:, :2], axis=0)
    spacing = max(float(np.median(nearest[:, 1])), float(np.sqrt(sides.prod() / len(target.points))))
    columns, rows = (max(MIN_CORNERS, round(side / spacing) + 1) for side in sides.tolist())
    return Checkerboard(columns, rows, square=spacing if target.unit == "m" else None)
