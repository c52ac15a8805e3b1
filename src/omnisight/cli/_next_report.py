"""Report of `omnisight next`."""

from typing import Any

import numpy as np

from omnisight.cli._output import write_json
from omnisight.geometry.sphere import angle_from_axis
from omnisight.targets import Detections, PointTarget
from omnisight.view_planning.description import (
    FACING_RAD,
    board_width,
    describe_placement,
    describe_view,
    direction_text,
    error_text,
    image_side,
    nearer_edge,
)
from omnisight.view_planning.information_prior import InformationPrior
from omnisight.view_planning.proposal import NextView, Proposal, WorstDirection, unknown_error_px


def print_report(proposal: Proposal, detections: Detections) -> None:
    """Print the current uncertainty and where to hold the board for the next images."""
    prior, worst, target = proposal.prior, proposal.worst, detections.board
    is_point_target = isinstance(target, PointTarget) and len(target.points) != proposal.board.size
    print(
        f"images    {len(detections.found)} of {len(detections.images)} show"
        f" {target if is_point_target else f'the {proposal.board} board'}, {len(prior.observations.pixels)} corners up"
        f" to {np.degrees(prior.theta_max):.0f}° off-axis"
    )
    print(f"worst     {error_text(prior, worst)} (1σ), {direction_text(prior, worst)}")
    if not worst.is_calibrated:
        inside = proposal.worst_calibrated
        print(f"          calibrated field of view: {error_text(prior, inside)}, {direction_text(prior, inside)}")
    if detections.hint:
        print(f"note      {detections.hint}")
    if not proposal.views:
        print("note      no placement shows a third of this board: use a larger board, or a shorter distance")
    elif proposal.is_sufficient:
        print("note      the uncertainty is already low: further images would reduce it only slightly")
    for number, view in enumerate(proposal.views, 1):
        print(f"{number}. {describe_view(proposal, view)}")


def print_json(proposal: Proposal, detections: Detections) -> None:
    """Print the proposal as one JSON object."""
    prior = proposal.prior
    result = {
        "images": len(detections.found),
        "images_given": len(detections.images),
        "corners": len(prior.observations.pixels),
        "board": proposal.board.to_dict(),
        "calibrated_deg": float(np.degrees(prior.theta_max)),
        "worst": _worst_json(prior, proposal.worst),
        "worst_calibrated": _worst_json(prior, proposal.worst_calibrated),
        "sufficient": proposal.is_sufficient,
        "warnings": [detections.hint] if detections.hint else [],
        "next": [_view_json(proposal, view) for view in proposal.views],
    }
    write_json(result)


def _worst_json(prior: InformationPrior, worst: WorstDirection) -> dict[str, Any]:
    return {
        "px": worst.error_px,
        "unknown": worst.error_px >= unknown_error_px(prior),
        "pixel": worst.pixel.tolist(),
        "theta_deg": float(np.degrees(worst.theta)),
        "side": image_side(prior, worst.pixel),
        "calibrated": worst.is_calibrated,
        "rms_px": worst.rms_px,
    }


def _view_json(proposal: Proposal, view: NextView) -> dict[str, Any]:
    prior, board = proposal.prior, proposal.board
    centre = view.cam_from_board @ board.points.mean(0)
    pixel = prior.camera.model.project_numpy(centre[None])[0][0]
    distance = float(np.linalg.norm(centre))
    return {
        "pixel": pixel.tolist(),
        "side": image_side(prior, pixel),
        "theta_deg": float(np.degrees(angle_from_axis(centre))),
        "distance": distance,
        "unit": board.unit,
        "distance_widths": distance / board_width(board),
        "tilt_deg": float(np.degrees(view.tilt)),
        "nearer_edge": nearer_edge(prior, view, board)[0] if view.tilt >= FACING_RAD else None,
        "visible_fraction": view.visible_fraction,
        "cam_from_board": {
            "rotation": view.cam_from_board.rotation.tolist(),
            "translation": view.cam_from_board.translation.tolist(),
        },
        "before": _worst_json(prior, view.before),
        "after": _worst_json(prior, view.after),
        "description": describe_placement(proposal, view),
    }
