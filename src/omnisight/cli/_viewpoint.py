"""What `omnisight calibrate` says of the viewpoint: one point, or places along the axis."""

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from omnisight.calibrate import PicturesCalibration
from omnisight.calibrate.rays import Asked, RaysCalibration

if TYPE_CHECKING:
    from rich.console import Console


def print_viewpoint(out: "Console", asked: Asked | None, traced: RaysCalibration | None) -> None:
    """Print whether the rays meet in a point, and what a central camera leaves near and far."""
    from rich.table import Table

    if asked is None:
        return
    out.print(f"viewpoint: {asked}.", soft_wrap=True)
    table = Table("central camera, for what is", "rms px", "worst px", "worst deg", box=None, pad_edge=False)
    for column in table.columns[1:]:
        column.justify = "right"
    left = asked.left
    for k in range(len(left.distances)):
        worst = f"{np.degrees(left.worst_angles[k]):.3f}"
        table.add_row(
            f"{asked.distance(k)} away is off by", f"{left.rms_pixels[k]:.3f}", f"{left.worst_pixels[k]:.3f}", worst
        )
    if asked.needed or asked.open or traced is not None:
        out.print(table)
    if (asked.needed or asked.open) and traced is None:
        out.print("--model axial fits several lenses so, and writes the camera whose viewpoint moves.", soft_wrap=True)
    if traced is not None:
        out.print(f"written is {traced.reason}", soft_wrap=True)
        out.print(
            "the tables and the figures here are those of the central camera beside it, the verdict is on what is"
            " written",
            soft_wrap=True,
        )


def judged_as_written(result: PicturesCalibration, traced: RaysCalibration | None) -> PicturesCalibration:
    """Give the result with the verdict on the camera that is written."""
    if traced is None:
        return result
    trust = replace(result.calibration.trust, verdict=traced.verdict)
    return replace(result, calibration=replace(result.calibration, trust=trust))


def viewpoint_json(asked: Asked | None, traced: RaysCalibration | None) -> dict[str, Any]:
    """Give the same as figures."""
    said: dict[str, Any] = {"viewpoint": None if asked is None else asked.as_dict()}
    if traced is not None:
        said["rays"] = {
            "model": traced.camera.model.name,
            "needed": traced.needed,
            "reason": traced.reason,
            "rms": traced.rms,
            "held_out_rms": traced.held_out_rms,
            "candidates": [candidate.as_dict() for candidate in traced.candidates],
        }
    return said
