"""What the chosen model leaves: a spline bends to any lens, and shows what could be had, and where."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.candidate import COMPARED, Candidate
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.model_starts import spline_start
from omnisight.calibration.state import State
from omnisight.geometry.sphere import angle_from_axis
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

RINGS = 6
# A spline that is so many times as far off as the model, on images held out, is not told by the others.
UNTOLD = 1.5


@dataclass(frozen=True)
class SplineBaseline:
    """The spline beside the chosen model, both on corners that they were not calibrated on.

    Attributes
    ----------
    candidate
        The spline, fitted to no more of the corners than tell it.
    edges
        (R + 1,) angles from the axis, radians, between rings of as many corners each.
    model_rms, spline_rms
        (R,) rms, px, of the held-out residuals of the chosen model and of the spline in each ring.
    left
        What the chosen model leaves on the table: the root of the difference of the squares over all corners, px; 0
        where the spline is no better.
    """

    candidate: Candidate
    edges: Array
    model_rms: Array
    spline_rms: Array
    left: float

    @property
    def where(self) -> int:
        """The ring in which most is left."""
        return int(np.argmax(self.model_rms**2 - self.spline_rms**2))

    def __str__(self) -> str:
        """Say it in one sentence."""
        held_out = self.candidate.held_out_rms or 0.0
        if held_out > UNTOLD * np.sqrt((self.model_rms**2).mean()):
            poor = f"so few images tell no spline ({held_out:.3f} px on images held out)"
            return f"{poor}: what the model leaves is open"
        if self.left == 0.0:
            return f"a spline is no better on images held out ({held_out:.3f} px): the model leaves nothing"
        low, high = np.degrees(self.edges[self.where : self.where + 2])
        ring = f"{self.model_rms[self.where]:.3f} against {self.spline_rms[self.where]:.3f} px"
        return (
            f"a spline has {held_out:.3f} px on images held out: the model leaves {self.left:.3f} px, most of it"
            f" {low:.0f} to {high:.0f} degrees from the axis ({ring})"
        )

    def as_dict(self) -> dict[str, object]:
        """Give the figures by name; angles in degrees."""
        return {
            "corners": self.candidate.corners,
            "rms": self.candidate.rms,
            "held_out_rms": self.candidate.held_out_rms,
            "left": self.left,
            "edges_deg": [float(edge) for edge in np.degrees(self.edges)],
            "model_rms": [float(rms) for rms in self.model_rms],
            "spline_rms": [float(rms) for rms in self.spline_rms],
        }


def fit_spline_baseline(
    best: Candidate, scout: State, views: Observations, usable: NDArray[np.bool_], *, loss: str
) -> SplineBaseline | None:
    """Fit a spline to no more of the corners than tell it, and compare it with the best model on images held out.

    Parameters
    ----------
    best
        The chosen model; None comes back if it was not asked about images held out, or is the spline itself.
    scout
        Another state: the spline starts from it where it explains the corners better.
    views
        The corners.
    usable
        (N,) those that some model explains.
    loss
        As in `refine`.
    """
    if best.held_out_lengths is None or usable.sum() < RINGS or best.name == "spline":
        return None
    nearer = min(best.state, scout, key=lambda state: float(np.median(state.lengths(views))))
    start = replace(best, state=nearer).sketched(views, usable)[0].state
    best, views, usable = best.sketched(views, usable)
    if best.corners > len(views.pixels):  # both held out of as much
        best = best.held_out(views, usable, loss=loss)
    start = spline_start(start, views)
    freedom = FreeParameters.of(start.model, warp=best.freedom.warp)
    spline = Candidate.fit("spline", start, views, freedom, loss=loss, tolerance=COMPARED)
    spline = spline.held_out(views, usable, loss=loss)
    assert best.held_out_lengths is not None
    assert spline.held_out_lengths is not None
    angles = angle_from_axis(best.state.points(views)[0][usable])
    edges = np.quantile(angles, np.linspace(0, 1, RINGS + 1))
    ring = np.clip(np.searchsorted(edges, angles) - 1, 0, RINGS - 1)
    model, other = best.held_out_lengths[usable] ** 2, spline.held_out_lengths[usable] ** 2
    count = np.bincount(ring, minlength=RINGS)
    rms = [np.sqrt(np.bincount(ring, squares, RINGS) / np.maximum(count, 1)) for squares in (model, other)]
    left = float(np.sqrt(max(model.mean() - other.mean(), 0.0)))
    return SplineBaseline(spline, edges, rms[0], rms[1], left)
