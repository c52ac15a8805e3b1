"""Whether images evaluate_noncentrality for a camera whose viewpoint moves, and what a central one leaves."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.axial import axial_of, clearly_better
from omnisight.calibration.candidate import Candidate
from omnisight.calibration.covariance import camera_covariance
from omnisight.camera import Camera
from omnisight.optics.models.axial import Axial
from omnisight.quality.central_error import METRES, WIDTHS, CentralApproximationError, corners
from omnisight.quality.pupil_shift import PupilShift
from omnisight.quality.spline_baseline import SplineBaseline
from omnisight.ray_camera import RayCamera
from omnisight.targets.observations import Observations

if TYPE_CHECKING:
    from omnisight.pipeline.central import Calibration

Array = NDArray[np.float64]

# Coefficients of the place on the axis: one follows most fisheyes, and mirrors need the second.
COEFFICIENTS = 2
# A travel of so many standard deviations is one of the camera, or of a lens that the model does not follow.
SURE = 5.0


@dataclass(frozen=True)
class NonCentralityTest:
    """A central camera beside the same lens with a viewpoint that moves along the axis.

    Attributes
    ----------
    needed
        Whether images held out are explained better so, by more than chance.
    doubt
        Why it is open, or nothing: they would be, but a central spline explains them better still, so that the lens'
        profile may be what the camera lacks; or they are not, although the travel is many times its standard deviation,
        as where images are few.
    central_rms, axial_rms
        Root mean square residual of the two on images held out, px.
    travel, travel_sigma
        How far the viewpoint moves between the first and the last angle where corners were seen, and its standard
        deviation.
    unit
        Of the lengths: "m" or "squares".
    widths
        The distances in widths of the board; None where they are in metres.
    left
        What the central camera leaves at three distances.
    axial
        The other candidate.
    points
        (N, 3) corners that count, in its frame.
    """

    needed: bool
    doubt: str
    central_rms: float
    axial_rms: float
    travel: float
    travel_sigma: float
    unit: str
    widths: tuple[float, ...] | None
    left: CentralApproximationError
    axial: Candidate
    points: Array

    @property
    def open(self) -> bool:
        """Whether the images leave it open."""
        return bool(self.doubt)

    def length(self, value: float) -> str:
        """Write a length in its unit, metres as mm or m."""
        if self.unit != "m":
            return f"{value:.2g} {self.unit}"
        return f"{value:g} m" if value >= 0.1 else f"{1e3 * value:.2g} mm"

    def distance(self, k: int) -> str:
        """Say a distance of `left`."""
        if self.widths is None:
            return self.length(float(self.left.distances[k]))
        return f"{self.widths[k]:g} board width{'s' if self.widths[k] != 1 else ''}"

    def __str__(self) -> str:
        """Say it in one sentence."""
        moving = f"by {self.length(self.travel)} ± {self.length(self.travel_sigma)}"
        held = (
            f"images held out are {self.axial_rms:.3f} px off if the viewpoint moves along the axis ({moving}),"
            f" {self.central_rms:.3f} px if it stands still"
        )
        if self.needed:
            return f"the rays do not meet in a point: {held}"
        if self.open:
            return f"it is open whether the rays meet in a point: {held}; {self.doubt}"
        return f"the rays meet in a point, as far as these images tell: {held}"

    def as_dict(self) -> dict[str, Any]:
        """Give the figures by name; angles in degrees."""
        left = self.left
        return {
            "needed": self.needed,
            "open": self.open,
            "central_held_out_rms": _known(self.central_rms),
            "axial_held_out_rms": _known(self.axial_rms),
            "travel": _known(self.travel),
            "travel_sigma": _known(self.travel_sigma),
            "unit": self.unit,
            "central_leaves": [
                {
                    "distance": float(left.distances[k]),
                    "max_px": _known(left.worst_pixels[k]),
                    "rms_px": _known(left.rms_pixels[k]),
                    "max_deg": _known(np.degrees(left.worst_angles[k])),
                    "rms_deg": _known(np.degrees(left.rms_angles[k])),
                    "theta_deg": [round(float(t), 3) for t in np.degrees(left.theta)],
                    "px": [_known(p) for p in left.pixels[k]],
                }
                for k in range(len(left.distances))
            ],
        }


def evaluate_noncentrality(calibration: "Calibration", *, unit: str = "squares") -> NonCentralityTest | None:
    """Give what a calibration's images say of a viewpoint that moves along the axis.

    Parameters
    ----------
    calibration
        The central calibration; None comes back if it was not asked about images held out.
    unit
        Of the boards: "m", or "squares" where their size is not known.
    """
    asked, camera = calibration.trust.viewpoint, calibration.camera
    if asked is None or unit != "m":
        return asked
    model = asked.axial.state.model
    assert isinstance(model, Axial)
    cone = camera.theta_min, camera.theta_max or model.theta_max
    central = calibration.chosen.state.model
    left = CentralApproximationError.of(central, model, asked.points, size=camera.size, cone=cone, distances=METRES)
    return replace(asked, unit=unit, widths=None, left=left)


def run_noncentrality_test(
    best: Candidate, camera: Camera, views: Observations, usable: NDArray[np.bool_], ceiling: SplineBaseline | None
) -> NonCentralityTest | None:
    """Ask images whether a viewpoint that moves along the axis explains them better, the board's square as the unit.

    The chosen camera is fitted once more so, and both are asked about images held out. It costs about as much as one
    more candidate.

    Parameters
    ----------
    best, camera
        The central camera; None comes back if it was not asked about images held out.
    views, usable
        The corners, and (N,) those that some model explains.
    ceiling
        The spline beside it, if there is one.
    """
    if best.held_out_lengths is None or not usable.any():
        return None
    best, views, usable = best.sketched(views, usable)  # the same that the ceiling has
    axial = axial_of(best, views, COEFFICIENTS, loss="huber").held_out(views, usable, loss="huber")
    moving = RayCamera(
        cast(Axial, axial.state.model),
        camera.size,
        "squares",
        theta_max=camera.theta_max,
        theta_min=camera.theta_min,
        covariance=camera_covariance(axial, views),
    )
    return compared(best, axial, moving, views, usable, ceiling)


def compared(
    central: Candidate,
    axial: Candidate,
    camera: RayCamera,
    views: Observations,
    usable: NDArray[np.bool_],
    ceiling: SplineBaseline | None,
) -> NonCentralityTest:
    """Compare a central camera with an axial one, both asked about the same images held out.

    Parameters
    ----------
    central, axial
        The two.
    camera
        The axial one, with its covariance.
    views, usable
        The corners, and (N,) those that some model explains.
    ceiling
        The central spline beside them, if there is one.
    """
    assert central.held_out_lengths is not None
    better = clearly_better(axial, central, views, usable)
    spline = None if ceiling is None else ceiling.candidate.held_out_rms
    doubtful = better and spline is not None and spline < (axial.held_out_rms or 0.0)
    model = camera.model
    assert isinstance(model, Axial)
    assert camera.covariance is not None
    cone = camera.theta_min, camera.theta_max or model.theta_max
    travel = PupilShift.between(model, camera.covariance, cone)
    doubt = "a central spline has less than either" if doubtful else ""
    if not better and travel.length > SURE * travel.length_sigma:
        doubt = "yet so large a travel is no chance: more images, very near and far and out to the rim, can tell"
    width = float(np.ptp(views.extent, axis=0).max())
    distances = METRES if camera.unit == "m" else tuple(width * times for times in WIDTHS)
    points = corners(axial.state, views, usable)
    return NonCentralityTest(
        better and not doubtful,
        doubt,
        float(np.sqrt((central.held_out_lengths[usable] ** 2).mean())),
        axial.held_out_rms or 0.0,
        travel.length,
        travel.length_sigma,
        camera.unit,
        None if camera.unit == "m" else WIDTHS,
        CentralApproximationError.of(
            central.state.model, model, points, size=camera.size, cone=cone, distances=distances
        ),
        axial,
        points,
    )


def _known(value: float) -> float | None:
    """Give a figure as JSON holds it; None where it is not known."""
    return float(value) if np.isfinite(value) else None
