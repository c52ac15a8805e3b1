"""Non-central test: whether an entrance pupil that shifts along the axis explains held-out views better."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.candidate import Candidate
from omnisight.calibration.covariance import camera_covariance
from omnisight.calibration.model_selection import CLAIM_SIGNIFICANCE, gain_p_value, is_better
from omnisight.calibration.noncentral import PUPIL_COEFFICIENTS, fit_axial
from omnisight.calibration.residual_weights import OUTLIER_SIGMA
from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.models import Projector
from omnisight.optics.models.axial import Axial
from omnisight.quality.central_error import DISTANCES_BOARD_WIDTHS, DISTANCES_M, CentralApproximationError
from omnisight.quality.pupil_shift import PupilShift
from omnisight.quality.spline_baseline import SplineBaseline
from omnisight.quality.split_half import SplitHalfTest, run_split_half_test
from omnisight.ray_camera import RayCamera
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

# Length (m) from which lengths are printed in metres.
MIN_PRINTED_M = 0.1


@dataclass(frozen=True)
class NonCentralityTest(Displayed):
    """A central camera compared with the same lens and an entrance pupil that shifts along the axis.

    Attributes
    ----------
    is_noncentral
        Whether the shift lowers the held-out error relevantly and at the significance `CLAIM_SIGNIFICANCE`, both for
        this lens and for the spline baseline, which can represent any central lens.
    p_value
        Probability that chance lowers the held-out error as much for this lens.
    doubt
        Why the test is inconclusive; empty if it is not.
    central_rms, axial_rms
        Held-out rms of the two, px.
    shift, shift_sigma
        Entrance pupil shift between the least and the greatest angle of the corners, and its standard deviation.
    unit
        Unit of the lengths: "m" or "squares".
    board_widths
        The distances of `central_error` in board widths; None if they are in metres.
    central_error
        Error of the central camera at three distances.
    axial
        The camera with the shift.
    axial_split_half
        Split-half test of the camera with the shift; None if the camera is not non-central, or there are few views.
    """

    is_noncentral: bool
    p_value: float
    doubt: str
    central_rms: float
    axial_rms: float
    shift: float
    shift_sigma: float
    unit: str
    board_widths: tuple[float, ...] | None
    central_error: CentralApproximationError
    axial: Candidate
    axial_split_half: SplitHalfTest | None = None

    @property
    def is_inconclusive(self) -> bool:
        """Whether the images do not decide."""
        return bool(self.doubt)

    def length(self, value: float) -> str:
        """Format a length in its unit, metres as mm or m."""
        if self.unit != "m":
            return f"{value:.2g} {self.unit}"
        return f"{value:g} m" if value >= MIN_PRINTED_M else f"{1e3 * value:.2g} mm"

    def distance(self, k: int) -> str:
        """Format a distance of `central_error`."""
        if self.board_widths is None:
            return self.length(float(self.central_error.distances[k]))
        return f"{self.board_widths[k]:g} board width{'s' if self.board_widths[k] != 1 else ''}"

    def __str__(self) -> str:
        """Describe the result in one sentence."""
        errors = (
            f"held-out error {self.axial_rms:.3f} px with an entrance pupil shift of {self.length(self.shift)} ±"
            f" {self.length(self.shift_sigma)}, {self.central_rms:.3f} px without (p = {self.p_value:.2g})"
        )
        if self.is_noncentral:
            return f"the camera is non-central: {errors}"
        if self.is_inconclusive:
            return f"it is undecided whether the camera is central: {errors}; {self.doubt}"
        return f"the images are consistent with a central camera: {errors}"

    def as_dict(self) -> dict[str, Any]:
        """Return the figures by name; angles in degrees."""
        error = self.central_error
        return {
            "is_noncentral": self.is_noncentral,
            "is_inconclusive": self.is_inconclusive,
            "p_value": _finite(self.p_value),
            "significance": CLAIM_SIGNIFICANCE,
            "central_held_out_rms": _finite(self.central_rms),
            "axial_held_out_rms": _finite(self.axial_rms),
            "shift": _finite(self.shift),
            "shift_sigma": _finite(self.shift_sigma),
            "unit": self.unit,
            "central_error": [
                {
                    "distance": float(error.distances[k]),
                    "max_px": _finite(error.max_pixels[k]),
                    "rms_px": _finite(error.rms_pixels[k]),
                    "max_deg": _finite(np.degrees(error.max_angles[k])),
                    "rms_deg": _finite(np.degrees(error.rms_angles[k])),
                    "theta_deg": [round(float(t), 3) for t in np.degrees(error.theta)],
                    "px": [_finite(p) for p in error.pixels[k]],
                }
                for k in range(len(error.distances))
            ],
        }


def run_noncentrality_test(
    best: Candidate, camera: Camera, observations: Observations, inliers: Bools, baseline: SplineBaseline | None
) -> NonCentralityTest | None:
    """Fit the selected camera with an entrance pupil shift and compare both on held-out views.

    Parameters
    ----------
    best, camera
        The central camera; without cross-validation, or without inliers, the result is None.
    observations, inliers
        All views and (N,) the inliers.
    baseline
        The spline baseline, if there is one.
    """
    if best.held_out_lengths is None or not inliers.any():
        return None
    best, observations, inliers = best.subsampled(observations, inliers)  # as for the spline baseline
    axial = fit_axial(best, observations, PUPIL_COEFFICIENTS, loss="huber")
    axial = axial.cross_validated(observations, inliers, loss="huber")
    assert isinstance(axial.state.model, Axial)
    axial_camera = RayCamera(
        axial.state.model,
        camera.size,
        unit=observations.unit,
        theta_max=camera.theta_max,
        theta_min=camera.theta_min,
        covariance=camera_covariance(axial, observations),
    )
    test = compare_central(best, axial, axial_camera, observations, inliers, baseline)
    if not test.is_noncentral:
        return test

    def as_camera(model: Projector, covariance: Array) -> Camera:
        return replace(axial_camera, model=model, covariance=covariance).central_limit

    return replace(test, axial_split_half=run_split_half_test(axial, observations, as_camera, loss="huber"))


def compare_central(
    central: Candidate,
    axial: Candidate,
    camera: RayCamera,
    observations: Observations,
    inliers: Bools,
    baseline: SplineBaseline | None,
) -> NonCentralityTest:
    """Compare a central and an axial candidate on the same held-out views.

    Parameters
    ----------
    central, axial
        The candidates.
    camera
        The camera of the axial candidate, with its covariance.
    observations, inliers
        The views of both, and (N,) the inliers.
    baseline
        The spline baseline, if there is one.
    """
    model, lens = camera.model, central.state.central_model
    assert isinstance(model, Axial)
    assert camera.covariance is not None
    cone = camera.theta_min, camera.theta_max or model.theta_max
    shift = PupilShift.between(model, camera.covariance, cone)
    p_value = gain_p_value(axial, central, observations, inliers)
    doubt = ""
    if is_better(axial, central, observations, inliers):
        doubt = _doubt(p_value, central, baseline)
    elif shift.length > OUTLIER_SIGMA * shift.length_sigma:
        doubt = "the shift is significant: more images, very near, far and close to the image circle, decide"
    width = float(np.ptp(observations.extent, axis=0).max())
    in_metres = camera.unit == "m"
    distances = DISTANCES_M if in_metres else tuple(width * widths for widths in DISTANCES_BOARD_WIDTHS)
    points = axial.state.points(observations)[0][inliers]
    return NonCentralityTest(
        not doubt and is_better(axial, central, observations, inliers),
        p_value,
        doubt,
        central.scored(inliers).held_out_rms or 0.0,
        axial.held_out_rms or 0.0,
        shift.length,
        shift.length_sigma,
        camera.unit,
        None if in_metres else DISTANCES_BOARD_WIDTHS,
        CentralApproximationError.of(lens, model, points, size=camera.size, cone=cone, distances=distances),
        axial,
    )


def _doubt(p_value: float, central: Candidate, baseline: SplineBaseline | None) -> str:
    """Return why a lower held-out error with a shift does not prove a non-central camera; empty if it does.

    A lens model that does not fit gains from a shift too. The spline baseline, which can represent any central lens,
    must gain as well. The hypothesis of a central camera is rejected only if both comparisons reject it, so the level
    is that of one of them.
    """
    if p_value >= CLAIM_SIGNIFICANCE:
        return f"the gain is not significant at {CLAIM_SIGNIFICANCE:g}; more images decide"
    if central.name == "spline":
        return ""
    if baseline is None or not baseline.is_reliable:
        return "without a reliable spline baseline, the lens model may be the cause; more images decide"
    spline, observations, inliers = baseline.candidate, baseline.observations, baseline.inliers
    axial = fit_axial(spline, observations, PUPIL_COEFFICIENTS, loss="huber")
    axial = axial.cross_validated(observations, inliers, loss="huber")
    if is_better(axial, spline, observations, inliers, CLAIM_SIGNIFICANCE):
        return ""
    p_spline = gain_p_value(axial, spline, observations, inliers)
    return f"a spline, which fits any central lens, does not gain significantly from a shift (p = {p_spline:.2g})"


def _finite(value: float) -> float | None:
    """Return a figure for JSON; None if it is not finite."""
    return float(value) if np.isfinite(value) else None
