"""Description of a proposed placement in words: where to hold the board, how far away and how tilted."""

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.sphere import angle_from_axis
from omnisight.quality.coverage import SECTORS, SIDES
from omnisight.targets import Board
from omnisight.view_planning.board_placements import point_spacing
from omnisight.view_planning.information_prior import InformationPrior
from omnisight.view_planning.proposal import NextView, Proposal, WorstDirection, unknown_error_px

Array = NDArray[np.float64]

# Limits of "centre" and "edge" as shares of the largest visible angle off-axis.
CENTRE_SHARE, EDGE_SHARE = 0.15, 0.65
# Directions within this azimuth of another one are on the same side of the image.
SIDE_RAD = np.radians(20)
# A board with a smaller tilt faces the camera.
FACING_RAD = np.radians(5)


def describe_view(proposal: Proposal, view: NextView) -> str:
    """Describe a proposed image in one sentence."""
    error = (
        f"{error_text(proposal.prior, view.before)} -> {'about ' if _is_extrapolated(proposal, view) else ''}"
        f"{error_text(proposal.prior, view.after)}"
    )
    return f"{describe_placement(proposal, view)}: worst-case uncertainty {error}"


def _visible_reach(proposal: Proposal, direction: Array) -> float:
    """Return the largest visible angle off-axis on the side of a direction (3,): an image cuts its circle."""
    visible = proposal.directions
    along = visible.bearings[:, :2] @ direction[:2]
    lengths = np.linalg.norm(visible.bearings[:, :2], axis=1) * np.linalg.norm(direction[:2])
    beside = along >= np.cos(SIDE_RAD) * lengths
    return float(visible.theta[beside].max()) if beside.any() else float(visible.theta.max())


def describe_placement(proposal: Proposal, view: NextView) -> str:
    """Describe where to hold the board, how far away and how tilted."""
    prior, board = proposal.prior, proposal.board
    centre = view.cam_from_board @ board.points.mean(0)
    pixel = prior.camera.model.project_numpy(centre[None])[0][0]
    share = float(angle_from_axis(centre)) / _visible_reach(proposal, centre)
    side = image_side(prior, pixel)
    if share < CENTRE_SHARE:
        place = "in the centre"
    elif share < EDGE_SHARE:
        place = f"half-way to the {side} edge"
    else:
        place = f"near the {side} edge"
    return (
        f"hold the board {place} (pixel {pixel[0]:.0f}, {pixel[1]:.0f}), {distance_text(view, board)} away,"
        f" {tilt_text(prior, view, board)}"
    )


def error_text(prior: InformationPrior, worst: WorstDirection) -> str:
    """Format an error in px; above the unknown error its value is meaningless."""
    limit = unknown_error_px(prior)
    return f"{worst.error_px:.2g} px" if worst.error_px < limit else f"more than {limit:.0f} px"


def direction_text(prior: InformationPrior, worst: WorstDirection) -> str:
    """Format a direction, such as "101° off-axis, lower right"."""
    degrees = np.degrees(worst.theta)
    return "on the axis" if degrees < 1 else f"{degrees:.0f}° off-axis, {image_side(prior, worst.pixel)}"


def image_side(prior: InformationPrior, pixel: Array) -> str:
    """Return the side of the image that a pixel lies on, relative to the principal point."""
    offset = pixel - prior.camera.model.project_numpy(np.array([[0.0, 0.0, 1.0]]))[0][0]
    return SIDES[round(float(np.arctan2(offset[1], offset[0])) / (2 * np.pi / SECTORS)) % SECTORS]


def distance_text(view: NextView, board: Board) -> str:
    """Format the distance to the board's centre in the board's unit and in board widths."""
    distance = float(np.linalg.norm(view.cam_from_board @ board.points.mean(0)))
    length = f"{distance:.2f} m" if board.unit == "m" else f"{distance / point_spacing(board):.0f} squares"
    return f"{length} ({distance / board_width(board):.1f} board widths)"


def board_width(board: Board) -> float:
    """Return the longer side of the board, from its first point to its last."""
    return float(np.ptp(board.points, axis=0).max())


def tilt_text(prior: InformationPrior, view: NextView, board: Board) -> str:
    """Format the tilt and which edge, as seen in the image, is nearer to the camera."""
    if view.tilt < FACING_RAD:
        return "facing the camera"
    return f"tilted {np.degrees(view.tilt):.0f}° with its {nearer_edge(prior, view, board)[0]} edge nearer"


def nearer_edge(prior: InformationPrior, view: NextView, board: Board) -> tuple[str, Array]:
    """Return the name, as seen in the image, of the edge nearest to the camera, and its ends (2, 3) on the board."""
    (left, top, _), (right, bottom, _) = board.points.min(0), board.points.max(0)
    corners = np.array([(left, top, 0), (right, top, 0), (right, bottom, 0), (left, bottom, 0)])
    edges = np.stack([corners, np.roll(corners, -1, 0)], 1)
    middles = edges.mean(1)
    nearest = int(np.linalg.norm(view.cam_from_board @ middles, axis=1).argmin())
    centre = corners.mean(0)
    _, _, d_point, _ = prior.camera.model.project_with_jacobians((view.cam_from_board @ centre)[None])
    u, v = d_point[0] @ view.cam_from_board.rotation @ (middles[nearest] - centre)
    name = ("right" if u > 0 else "left") if abs(u) > abs(v) else ("lower" if v > 0 else "upper")
    return name, edges[nearest]


def _is_extrapolated(proposal: Proposal, view: NextView) -> bool:
    """Return whether the prediction relies on a camera that is unknown in the worst direction."""
    return view.before.error_px > unknown_error_px(proposal.prior) > view.after.error_px
