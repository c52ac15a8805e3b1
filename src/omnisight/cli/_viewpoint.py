"""What `omnisight calibrate` says of the viewpoint: one point, or places along the axis."""

from typing import TYPE_CHECKING, Any

import numpy as np

from omnisight.pipeline.central import Calibration
from omnisight.pipeline.noncentral import RaysCalibration
from omnisight.quality.noncentral_test import NonCentralityTest

if TYPE_CHECKING:
    from rich.console import Console


def print_viewpoint(out: "Console", asked: NonCentralityTest | None, found: Calibration | RaysCalibration) -> None:
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
        worst = f"{np.degrees(left.max_angles[k]):.3f}"
        table.add_row(
            f"{asked.distance(k)} away is off by", f"{left.rms_pixels[k]:.3f}", f"{left.max_pixels[k]:.3f}", worst
        )
    moves, rays = asked.needed or asked.open, isinstance(found, RaysCalibration)
    if moves or rays:
        out.print(table)
    if moves and not rays:
        out.print("--model axial fits several lenses so, and writes the camera whose viewpoint moves.", soft_wrap=True)


def viewpoint_json(asked: NonCentralityTest | None, found: Calibration | RaysCalibration) -> dict[str, Any]:
    """Give the same as figures."""
    said: dict[str, Any] = {"viewpoint": None if asked is None else asked.as_dict()}
    if isinstance(found, RaysCalibration):
        said["central"] = {**found.central.as_dict(), "enough": not found.needed}
    return said
