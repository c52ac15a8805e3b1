"""What `omnisight next` says: where to hold the board, in plain words."""

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.sphere import angle_from_axis
from omnisight.next_view.board_placements import spacing_of
from omnisight.next_view.information_prior import InformationPrior
from omnisight.next_view.proposal import NextView, Proposal, Worst, unknown_px
from omnisight.quality.coverage import SECTORS, SIDES
from omnisight.targets import Board, Detections, PointTarget

Array = NDArray[np.float64]

# Angles from the axis, as shares of the largest that the image shows, that are its middle, and from which on its rim.
MIDDLE, RIM = 0.15, 0.8
# A board tilted by less faces the camera.
FACING = np.radians(5)


def print_report(proposal: Proposal, search: Detections, board: Board) -> None:
    """Print how sure the camera is now, and where to hold the board next."""
    known, now, inside = proposal.known, proposal.now, proposal.inside
    corners = len(known.views.pixels)
    given = isinstance(search.board, PointTarget) and len(search.board.points) != board.size
    target = f"{search.board}" if given else f"the {board} board"
    print(f"{len(search.found)} of {len(search.images)} images show {target}, {corners} corners")
    if search.hint:
        print(f"note: {search.hint}")
    reach = f"corners reach {np.degrees(known.reach):.0f} degrees from the axis"
    print(f"least sure: {error_said(known, now)} {place_said(known, now)}; {reach}")
    if not now.calibrated:
        print(f"within what corners reach: {error_said(known, inside)} {place_said(known, inside)}")
    if not proposal.views:
        print(
            "no place was found to hold this board so that a third of it is seen: use a larger board, or hold it nearer"
        )
    elif proposal.enough:
        print("That is good already: more images will hardly help. If you take some all the same:")
    for number, view in enumerate(proposal.views, 1):
        print()
        print(f"{number}. {gain_said(known, view)}")
        for sentence in sentences(proposal, view, board):
            print(f"   {sentence}")


def as_json(proposal: Proposal, search: Detections, board: Board) -> None:
    """Print one object on stdout, and nothing else."""
    known = proposal.known
    said = {
        "images": len(search.found),
        "images_given": len(search.images),
        "corners": len(known.views.pixels),
        "board": board.to_dict(),
        "calibrated_deg": float(np.degrees(known.reach)),
        "worst": _worst(known, proposal.now),
        "worst_calibrated": _worst(known, proposal.inside),
        "enough": proposal.enough,
        "warnings": [search.hint] if search.hint else [],
        "next": [_view(proposal, view, board) for view in proposal.views],
    }
    print(json.dumps(said, indent=2, allow_nan=False))


def gain_said(known: InformationPrior, view: NextView) -> str:
    """Say what an image brings: 'worst uncertainty 1.36 px at 101 degrees lower right -> 0.61 px'."""
    before, after = view.before, view.after
    guessed = "about " if before.error > unknown_px(known) > after.error else ""  # from a camera that is a guess there
    said = f"worst uncertainty {error_said(known, before)} {place_said(known, before)}"
    said += f" -> {guessed}{error_said(known, after)}"
    if after.error > unknown_px(known):
        said += f" (on average {before.mean:.2g} -> {after.mean:.2g} px)"
    return said


def sentences(proposal: Proposal, view: NextView, board: Board) -> list[str]:
    """Say where to hold the board, how far, and how tilted."""
    known = proposal.known
    middle = view.cam_from_board @ board.points.mean(0)
    pixel = known.camera.model.project_numpy(middle[None])[0][0]
    theta = float(angle_from_axis(middle))
    share = theta / float(proposal.visible.theta.max())
    side = side_of(known, pixel)
    if share < MIDDLE:
        where = "in the middle of the image"
    elif share < RIM:
        where = f"between middle and rim, {side}"
    else:
        where = f"near the rim, {side}"
    said = [
        f"Where: {where}; its middle at pixel ({pixel[0]:.0f}, {pixel[1]:.0f}),"
        f" {np.degrees(theta):.0f} degrees from the axis.",
        f"How far: {distance_said(view, board)} from the camera to the middle of the board.",
        f"How tilted: {tilt_said(known, view, board)}.",
    ]
    if view.part <= 0.9:
        said.append(f"About {1 - view.part:.0%} of its corners will not be found there, which does no harm.")
    return said


def error_said(known: InformationPrior, worst: Worst) -> str:
    """Say an error; past `unknown_px` its number says nothing."""
    limit = unknown_px(known)
    return f"{worst.error:.3g} px" if worst.error < limit else f"more than {limit:.0f} px"


def place_said(known: InformationPrior, worst: Worst) -> str:
    """Say where an error is: 'at 101 degrees lower right'."""
    degrees = np.degrees(worst.theta)
    return "on the axis" if degrees < 1 else f"at {degrees:.0f} degrees {side_of(known, worst.pixel)}"


def side_of(known: InformationPrior, pixel: Array) -> str:
    """Name the side of the image that a pixel lies on, as seen from where the axis is."""
    away = pixel - known.camera.model.project_numpy(np.array([[0.0, 0.0, 1.0]]))[0][0]
    return SIDES[round(float(np.arctan2(away[1], away[0])) / (2 * np.pi / SECTORS)) % SECTORS]


def distance_said(view: NextView, board: Board) -> str:
    """Say how far the board's middle is, in board widths and in what its points are in."""
    distance = float(np.linalg.norm(view.cam_from_board @ board.points.mean(0)))
    widths = f"{distance / width_of(board):.1f} board widths"
    if board.unit == "m":
        length = f"{100 * distance:.0f} cm" if distance < 1.5 else f"{distance:.1f} m"
    else:
        length = f"{distance / spacing_of(board):.0f} squares"
    return f"{widths} ({length})"


def width_of(board: Board) -> float:
    """Give the longer side of the board, from its first point to its last."""
    return float(np.ptp(board.points, axis=0).max())


def tilt_said(known: InformationPrior, view: NextView, board: Board) -> str:
    """Say how the board is tilted, and which of its edges, as the image shows them, is nearer to the camera."""
    if view.tilt < FACING:
        return "not at all: it faces the camera"
    return f"{np.degrees(view.tilt):.0f} degrees, its {nearer_edge(known, view, board)[0]} edge towards the camera"


def nearer_edge(known: InformationPrior, view: NextView, board: Board) -> tuple[str, Array]:
    """Give the name, in the image, of the edge that is nearest to the camera, and its ends (2, 3) on the board."""
    (left, top, _), (right, bottom, _) = board.points.min(0), board.points.max(0)
    corners = np.array([(left, top, 0), (right, top, 0), (right, bottom, 0), (left, bottom, 0)])
    edges = np.stack([corners, np.roll(corners, -1, 0)], 1)
    middles = edges.mean(1)
    nearest = int(np.linalg.norm(view.cam_from_board @ middles, axis=1).argmin())
    centre = corners.mean(0)
    _, _, d_point, _ = known.camera.model.project_with_jacobians((view.cam_from_board @ centre)[None])
    u, v = d_point[0] @ view.cam_from_board.rotation @ (middles[nearest] - centre)
    name = ("right" if u > 0 else "left") if abs(u) > abs(v) else ("lower" if v > 0 else "upper")
    return name, edges[nearest]


def _worst(known: InformationPrior, worst: Worst) -> dict[str, Any]:
    return {
        "px": worst.error,
        "unknown": worst.error >= unknown_px(known),
        "pixel": worst.pixel.tolist(),
        "theta_deg": float(np.degrees(worst.theta)),
        "side": side_of(known, worst.pixel),
        "calibrated": worst.calibrated,
        "mean_px": worst.mean,
    }


def _view(proposal: Proposal, view: NextView, board: Board) -> dict[str, Any]:
    known = proposal.known
    middle = view.cam_from_board @ board.points.mean(0)
    pixel = known.camera.model.project_numpy(middle[None])[0][0]
    distance = float(np.linalg.norm(middle))
    return {
        "pixel": pixel.tolist(),
        "side": side_of(known, pixel),
        "theta_deg": float(np.degrees(angle_from_axis(middle))),
        "distance": distance,
        "unit": board.unit,
        "distance_widths": distance / width_of(board),
        "tilt_deg": float(np.degrees(view.tilt)),
        "nearer_edge": nearer_edge(known, view, board)[0] if view.tilt >= FACING else None,
        "corners_found": view.part,
        "cam_from_board": {
            "rotation": view.cam_from_board.rotation.tolist(),
            "translation": view.cam_from_board.translation.tolist(),
        },
        "before": _worst(known, view.before),
        "after": _worst(known, view.after),
        "words": " ".join(sentences(proposal, view, board)),
    }
