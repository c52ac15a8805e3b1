"""Alternative model check: whether a model with a free radial profile explains the lines significantly better."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.free_parameters import FreeParameters, with_square_pixels
from omnisight.calibration.lines.consensus import select_lines
from omnisight.calibration.lines.focal_scale import fix_focal_scale
from omnisight.calibration.lines.pixel_chains import PixelChains
from omnisight.calibration.lines.plumb_line import (
    PlumbLineProblem,
    PlumbLineState,
    fit_line_planes,
    huber_loss,
    refine_plumb_lines,
)
from omnisight.calibration.lines.uncertainty import LinesUncertainty, bearing_difference
from omnisight.models import CameraModel
from omnisight.models.kannala_brandt import KannalaBrandt

Array = NDArray[np.float64]

# Parameters that lines of a camera with square pixels do not need.
FIXED_PARAMETERS = ("skew", "c", "d", "e")
# Shape parameters of the alternative, k1 to k4: the decrease of chi^2 that they cause by chance has this expectation.
EXTRA_PARAMETERS = 4
# Pixels per line that the comparison uses.
COMPARED_PIXELS = 60


def convert_model(
    cls: type[CameraModel], state: PlumbLineState, chains: PixelChains, *, square: bool, fixed: Mapping[str, float]
) -> PlumbLineState:
    """Fit another camera model to the bearings of the lines' pixels.

    Raises
    ------
    ValueError
        If the model cannot represent the bearings.
    """
    samples = chains.subsample(COMPARED_PIXELS)
    bearings, valid = state.model.unproject_numpy(samples.pixels)
    try:
        model = cls.fit(bearings[valid], samples.pixels[valid], fixed=FIXED_PARAMETERS)
    except (ValueError, np.linalg.LinAlgError) as error:
        raise ValueError(f"{cls.name} cannot represent this camera: {error}") from None
    return PlumbLineState((with_square_pixels(model) if square else model).with_values(fixed), state.normals)


def estimate_model_error(
    state: PlumbLineState,
    chains: PixelChains,
    free_parameters: FreeParameters,
    uncertainty: LinesUncertainty,
    arcs: PixelChains | None,
) -> float:
    """Return the bearing difference (radians, rms) from an alternative model that explains the lines better.

    The alternative is Kannala-Brandt at the same scale, which lines do not determine. It selects its own lines out of
    `arcs`, if given, because the given lines were selected to agree with the first model. Return zero if the decrease
    of the cost is not significant.
    """
    samples = chains.subsample(COMPARED_PIXELS)
    try:
        other = convert_model(KannalaBrandt, state, samples, square=True, fixed={})
    except ValueError:
        return 0.0
    for _ in range(1 if arcs is None else 2):
        other = _refine_alternative(other, samples)
        if arcs is not None:
            samples = select_lines(other.model, arcs).lines.subsample(COMPARED_PIXELS)
            other = fit_line_planes(other.model, samples)
    other = _refine_alternative(other, samples)
    initial = fit_line_planes(state.model, samples)
    own = refine_plumb_lines(initial, samples, free_parameters, iterations=10, tolerance=1e-6).state
    problem = PlumbLineProblem(samples, huber_loss(uncertainty.sigma), free_parameters)
    # Each line counts as one observation, because the errors of its pixels are correlated.
    relative_decrease = problem.cost(own) / max(problem.cost(other), 1e-300) - 1
    if relative_decrease * max(len(samples) - EXTRA_PARAMETERS, 1) < EXTRA_PARAMETERS:
        return 0.0
    return bearing_difference(state.model, other.model, samples.pixels)


def _refine_alternative(state: PlumbLineState, samples: PixelChains) -> PlumbLineState:
    """Refine the alternative model at a fixed focal scale."""
    all_free = FreeParameters.of(state.model, square=True)
    free_parameters = fix_focal_scale(all_free, state.model, samples.pixels)
    return refine_plumb_lines(state, samples, free_parameters, iterations=30, tolerance=1e-6).state
