"""The result of a calibration from lines, with its warnings."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.lines.estimation import REFINED_PIXELS, LineEstimate
from omnisight.calibration.lines.focal_scale import scale_bearing_sigma
from omnisight.calibration.lines.observations import LineObservations
from omnisight.calibration.lines.pixel_chains import PixelChains
from omnisight.calibration.lines.plumb_line import PlumbLineState
from omnisight.calibration.lines.uncertainty import LinesUncertainty, bearing_sigma
from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.geometry.sphere import angle_from_axis

Array = NDArray[np.float64]

# Warn if the standard deviation of the bearings, or the model error, exceeds these angles.
WARN_BEARING_SIGMA_RAD, WARN_MODEL_ERROR_RAD = np.radians(3.0), np.radians(1.0)
# Warn if the covariance exceeds that of independent pixels by this factor: some edges are probably not straight.
WARN_INFLATION = 80.0
# Warn if the lines' pixels are farther off (px, rms): detected edges are accurate to 0.2 px.
WARN_RMS_PX = 1.0
# Warn if fewer lines, or a smaller share of the arcs, support the camera.
WARN_LINES, WARN_INLIER_SHARE = 6, 0.3


@dataclass(frozen=True)
class LinesCalibration(Displayed):
    """A camera calibrated from images of straight lines.

    Attributes
    ----------
    camera
        The camera with its covariance; `theta_max` is the largest angle off-axis of a line's pixel.
    estimate
        The refined state, the uncertainty and the model error.
    arcs
        All arcs, including outliers.
    line_of_arc
        (A,) index of the line that each arc belongs to, -1 for outliers.
    is_xi_fixed
        Whether a known xi determines the scale of tan(theta). Otherwise the scale follows from the shape of the
        model's radial profile, which real cameras match only approximately.
    bearing_sigma
        Standard deviation of the bearings of the lines' pixels, radians; see `bearing_sigma_at`.
    rms
        Root mean square distance of the pixels from their lines, px.
    warnings
        Reasons to doubt the result, one sentence each.
    """

    camera: Camera
    estimate: LineEstimate
    arcs: PixelChains
    line_of_arc: NDArray[np.intp]
    is_xi_fixed: bool
    bearing_sigma: float
    rms: float
    warnings: tuple[str, ...]

    @classmethod
    def from_estimate(
        cls,
        estimate: LineEstimate,
        observations: LineObservations,
        line_of_arc: NDArray[np.intp],
        *,
        is_xi_fixed: bool,
        provenance: dict[str, Any],
    ) -> "LinesCalibration":
        """Assemble the camera, its figures and the warnings."""
        state, lines, uncertainty = estimate.consensus.state, estimate.consensus.lines, estimate.uncertainty
        theta_max = float(np.nanmax(angle_from_axis(state.foot_points(lines))))
        rms = float(np.sqrt((state.distances(lines) ** 2).mean()))
        sigma = _bearing_sigma(estimate, lines.subsample(REFINED_PIXELS).pixels, is_xi_fixed)
        figures = {
            "method": "lines",
            "rms": rms,
            "sigma": uncertainty.sigma,
            "lines": len(lines),
            "arcs": int((line_of_arc >= 0).sum()),
            "arcs_rejected": int((line_of_arc < 0).sum()),
            "pixels": len(lines.pixels),
            "images": len(np.unique(lines.image_ids)),
            "inflation": uncertainty.inflation,
            "bearing_sd_deg": float(np.degrees(sigma)),
            "model_error_deg": float(np.degrees(estimate.model_error)),
            "scale_fixed": estimate.is_scale_fixed,
        }
        camera = Camera(
            state.model,
            observations.size,
            theta_max=theta_max,
            calibration=figures,
            covariance=uncertainty.covariance,
            provenance=provenance,
        )
        warnings = _warnings(estimate, rms, sigma, len(line_of_arc), observations.size)
        return cls(camera, estimate, observations.arcs, line_of_arc, is_xi_fixed, sigma, rms, warnings)

    @property
    def state(self) -> PlumbLineState:
        """The model with the plane of each line."""
        return self.estimate.consensus.state

    @property
    def lines(self) -> PixelChains:
        """Pixels of the lines; arcs of one line are joined."""
        return self.estimate.consensus.lines

    @property
    def uncertainty(self) -> LinesUncertainty:
        """Uncertainty of the parameters."""
        return self.estimate.uncertainty

    def bearing_sigma_at(self, pixels: Array) -> float:
        """Return the standard deviation (radians, rms) of the bearings of pixels (N, 2), up to a camera rotation.

        It combines the covariance of the parameters, the model error and the uncertainty of the scale of tan(theta).
        """
        return _bearing_sigma(self.estimate, pixels, self.is_xi_fixed)

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Properties of the camera that lines do not determine."""
        handedness = "handedness (a mirror swaps left and right)"
        return (handedness, "scale of tan(theta)") if self.estimate.is_scale_fixed else (handedness,)


def _bearing_sigma(estimate: LineEstimate, pixels: Array, is_xi_fixed: bool) -> float:
    """Return the combined standard deviation (radians, rms) of the bearings of pixels (N, 2)."""
    parts = [bearing_sigma(estimate.model, estimate.uncertainty.covariance, pixels), estimate.model_error]
    if not is_xi_fixed:
        parts.append(scale_bearing_sigma(estimate.model, pixels))
    return float(np.linalg.norm(parts))


def _warnings(estimate: LineEstimate, rms: float, sigma: float, arcs: int, size: tuple[int, int]) -> tuple[str, ...]:
    """Return the reasons to doubt the result, each with what to do."""
    name, lines = estimate.model.name, len(estimate.consensus.lines)
    inflation, model_error = estimate.uncertainty.inflation, estimate.model_error
    conditions = (
        (
            size[0] == 2 * size[1],
            f"The image is {size[0]}x{size[1]} px, twice as wide as high: equirectangular images need no calibration"
            " (omnisight view, without --camera), and no camera of this command describes them.",
        ),
        (
            estimate.is_scale_fixed,
            f"Lines do not determine the scale of tan(theta) of {name}, because its radial profile is free. It is fixed"
            " to that of the unified model.",
        ),
        (lines < WARN_LINES, f"Only {lines} lines: the uncertainty is unreliable. Use 10 or more."),
        (
            sigma > WARN_BEARING_SIGMA_RAD,
            f"Bearings have a standard deviation of {np.degrees(sigma):.1f} degrees. Use more and longer lines, all"
            " around and bent, or more images.",
        ),
        (
            model_error > WARN_MODEL_ERROR_RAD and not estimate.is_scale_fixed,
            f"kannala_brandt fits the lines better than {name}, with bearings {np.degrees(model_error):.1f} degrees"
            " away. Try --model kannala_brandt.",
        ),
        (
            inflation > WARN_INFLATION,
            f"Errors of whole lines are {np.sqrt(inflation):.0f} times larger than those of their pixels: some edges"
            " are probably not straight, or the model does not fit. Check the drawing (--draw), or draw lines manually"
            " (--lines).",
        ),
        (
            rms > WARN_RMS_PX,
            f"The rms distance of pixels from their lines is {rms:.1f} px. Check that {name} fits this camera and that"
            " the lines are straight.",
        ),
        (
            lines < WARN_INLIER_SHARE * arcs,
            f"Most of the {arcs} arcs are not images of lines for this camera. Check the drawing (--draw).",
        ),
    )
    return tuple(text for is_true, text in conditions if is_true)
