"""Estimation of a camera from line observations: consensus, refinement, uncertainty, model error."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.lines.alternative_model import convert_model, estimate_model_error
from omnisight.calibration.lines.consensus import MIN_LINES, LineConsensus, find_consensus, select_lines
from omnisight.calibration.lines.focal_scale import fix_focal_scale, has_free_radial_profile
from omnisight.calibration.lines.observations import LineObservations
from omnisight.calibration.lines.pixel_chains import PixelChains
from omnisight.calibration.lines.plumb_line import fit_line_planes, refine_plumb_lines
from omnisight.calibration.lines.uncertainty import (
    LinesUncertainty,
    bearing_sigma,
    fix_principal_point,
    update_with_border_centre,
    widen_by_split_half_test,
)
from omnisight.choices import Options
from omnisight.display import Displayed
from omnisight.extensions import did_you_mean
from omnisight.models import CameraModel, model_class
from omnisight.progress import StageProgress

# Alternations of line selection and refinement: selection is stable after five; without selection, two converge.
SELECTION_ROUNDS, FIXED_SELECTION_ROUNDS = 5, 2
# Pixels per line that are refined: more are correlated and only cost time.
REFINED_PIXELS = 150
# A camera with a larger standard deviation of its bearings is not determined by the lines.
MAX_BEARING_SIGMA_RAD = np.radians(30.0)


@dataclass(frozen=True)
class LineEstimationOptions(Options):
    """Options of the estimation from lines.

    Attributes
    ----------
    model
        Name of the camera model. Lines determine the unified model up to handedness; for models with a free radial
        profile the scale of tan(theta) is fixed to that of the unified model.
    fixed
        Known parameters of the model by name, such as {"xi": 1} for a parabolic mirror.
    square
        Whether pixels are square: fx = fy.
    loss
        "huber" or "squared".
    seed
        Seed of the random hypotheses.
    """

    model: str = "unified"
    fixed: Mapping[str, float] = field(default_factory=dict[str, float])
    square: bool = True
    loss: str = "huber"
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        parameters = {parameter.name: parameter for parameter in model_class(self.model).example().parameters}
        names = list(parameters)
        if unknown := sorted(set(self.fixed) - set(names)):
            raise ValueError(
                f"{self.model} has no {', '.join(unknown)}{did_you_mean(unknown[0], names)}; it has {', '.join(names)}"
            )
        for name, value in self.fixed.items():
            low, high = parameters[name].low, parameters[name].high
            if not (math.isfinite(value) and low <= value <= high):
                bounds = [f"at least {low:g}"] * math.isfinite(low) + [f"at most {high:g}"] * math.isfinite(high)
                within = " and ".join(["finite", *bounds])
                raise ValueError(f"--fix {name}={value:g}: {name} of {self.model} must be {within}")


@dataclass(frozen=True)
class LineEstimate(Displayed):
    """A camera refined on its lines.

    Attributes
    ----------
    consensus
        The camera, its lines, and the line of each arc.
    samples
        The lines, subsampled to `REFINED_PIXELS`.
    uncertainty
        Uncertainty of the parameters.
    free_parameters
        The estimated combinations of parameters.
    model_error
        Bearing difference (radians, rms) from an alternative model that explains the lines significantly better.
    is_scale_fixed
        Whether the scale of tan(theta) was fixed.
    """

    consensus: LineConsensus
    samples: PixelChains
    uncertainty: LinesUncertainty
    free_parameters: FreeParameters
    model_error: float = 0.0
    is_scale_fixed: bool = False

    @property
    def model(self) -> CameraModel:
        """The camera model."""
        return self.consensus.state.model

    @property
    def bearing_sigma(self) -> float:
        """Standard deviation of the bearings (radians, rms) from the covariance of the parameters."""
        return bearing_sigma(self.model, self.uncertainty.covariance, self.samples.pixels)

    @property
    def is_determined(self) -> bool:
        """Whether the lines determine the camera."""
        return not self.uncertainty.is_singular and self.bearing_sigma <= MAX_BEARING_SIGMA_RAD

    def with_model_error(self, observations: LineObservations) -> "LineEstimate":
        """Return the estimate with its model error."""
        arcs = None if observations.all_inliers else observations.arcs
        error = estimate_model_error(self.consensus.state, self.samples, self.free_parameters, self.uncertainty, arcs)
        return replace(self, model_error=error)


def estimate_unified_camera(
    observations: LineObservations, options: LineEstimationOptions, progress: StageProgress
) -> LineEstimate:
    """Find the consensus of the unified model and refine it; the known parameters are those of `options`.

    Raises
    ------
    ValueError
        If there are too few lines, or no camera explains three of them.
    """
    count = len(observations.arcs)
    if count < MIN_LINES:
        raise ValueError(f"{count} lines are too few: at least {MIN_LINES} are needed, 10 or more all around are good")
    fixed = options.fixed if options.model == "unified" else {}
    consensus = find_consensus(
        observations.arcs,
        observations.size,
        observations.expected_centre,
        fixed=fixed,
        square=options.square,
        all_inliers=observations.all_inliers,
        seed=options.seed,
    )
    free_parameters = FreeParameters.of(consensus.state.model, square=options.square, fixed=tuple(fixed))
    estimate = _refine(consensus, observations, free_parameters, options.loss, progress)
    if options.model == "unified" and not estimate.is_determined:
        raise ValueError(
            "the lines do not determine the camera: the standard deviation of its bearings is"
            f" {np.degrees(estimate.bearing_sigma):.0f} degrees. Use long lines that are bent in the image. A lens"
            " without distortion shows lines straight for every focal length: calibrate it with a board"
        )
    return estimate.with_model_error(observations)


def estimate_camera(
    unified: LineEstimate, observations: LineObservations, options: LineEstimationOptions, progress: StageProgress
) -> LineEstimate:
    """Refine another camera model, initialised from a unified camera.

    The scale of tan(theta) is fixed for models with a free radial profile, and where it proves unobservable.

    Raises
    ------
    ValueError
        If the model cannot represent the camera, or the lines do not determine its parameters.
    """
    cls, initial = model_class(options.model), unified.consensus
    state = convert_model(cls, initial.state, initial.lines, square=options.square, fixed=options.fixed)
    all_free = FreeParameters.of(state.model, square=options.square, fixed=tuple(options.fixed))
    for is_scale_fixed in (True,) if has_free_radial_profile(state.model) else (False, True):
        pixels = unified.samples.pixels
        free_parameters = fix_focal_scale(all_free, state.model, pixels) if is_scale_fixed else all_free
        estimate = _refine(replace(initial, state=state), observations, free_parameters, options.loss, progress)
        if estimate.is_determined and is_scale_fixed:
            error = float(np.hypot(unified.bearing_sigma, unified.model_error))
            return replace(estimate, model_error=error, is_scale_fixed=True)
        if estimate.is_determined:
            return estimate.with_model_error(observations)
    raise ValueError(
        f"lines do not determine the parameters of {options.model}: lines stay straight if some of them change; choose"
        " another model, or calibrate with a board"
    )


def _refine(
    consensus: LineConsensus,
    observations: LineObservations,
    free_parameters: FreeParameters,
    loss: str,
    progress: StageProgress,
) -> LineEstimate:
    """Alternate refinement and line selection, estimate the uncertainty, and apply the border centre."""
    arcs, all_inliers = observations.arcs, observations.all_inliers
    rounds = FIXED_SELECTION_ROUNDS if all_inliers else SELECTION_ROUNDS
    for k in range(rounds):
        progress(k, rounds)
        if k:
            consensus = select_lines(consensus.state.model, arcs, all_inliers=all_inliers, join=k == rounds - 1)
        if len(consensus.lines) < MIN_LINES:
            raise ValueError(
                f"only {len(consensus.lines)} of {len(arcs)} arcs are images of lines, at least {MIN_LINES} are needed:"
                " take an image with more straight lines, or draw them (--lines)"
            )
        samples = consensus.lines.subsample(REFINED_PIXELS)
        state = refine_plumb_lines(consensus.state, samples, free_parameters, loss=loss).state
        consensus = replace(consensus, state=state)
    progress(rounds, rounds)
    state, samples = consensus.state, consensus.lines.subsample(REFINED_PIXELS)
    uncertainty = LinesUncertainty.estimate(state, samples, free_parameters)
    uncertainty = widen_by_split_half_test(uncertainty, state, samples, free_parameters)
    estimate = LineEstimate(consensus, samples, uncertainty, free_parameters)
    if observations.border_centre is None or uncertainty.is_singular:
        return estimate
    return _apply_border_centre(estimate, observations, loss)


def _apply_border_centre(estimate: LineEstimate, observations: LineObservations, loss: str) -> LineEstimate:
    """Update the principal point with the border's centre, then refine the rest and select the lines once more."""
    assert observations.border_centre is not None
    consensus, samples = estimate.consensus, estimate.samples
    model, uncertainty = update_with_border_centre(
        estimate.model, estimate.uncertainty, observations.border_centre, samples.pixels
    )
    free_parameters = fix_principal_point(estimate.free_parameters, model)
    for reselect in (False,) if observations.all_inliers else (False, True):
        if reselect:
            selected = select_lines(model, observations.arcs, join=True)
            if len(selected.lines) < MIN_LINES:
                break
            consensus, samples = selected, selected.lines.subsample(REFINED_PIXELS)
        state = refine_plumb_lines(fit_line_planes(model, samples), samples, free_parameters, loss=loss).state
        model = state.model
        consensus = replace(consensus, state=state)
    return replace(estimate, consensus=consensus, samples=samples, uncertainty=uncertainty)
