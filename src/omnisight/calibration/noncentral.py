"""Non-central candidates: central lenses whose entrance pupil shifts along the axis, and cameras of known design."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from omnisight.calibration.candidate import Candidate
from omnisight.calibration.estimation_options import EstimationOptions, Loss
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.model_selection import MAX_RMS_RATIO, Selection, select_model
from omnisight.calibration.prescription import (
    resect_prescription,
    unobservable_parameters,
    with_designed_aperture,
    with_wide_aperture,
)
from omnisight.optics.models.axial import Axial
from omnisight.optics.ray_model import RayModel
from omnisight.targets.observations import Observations

Bools = NDArray[np.bool_]

# Coefficients of the entrance pupil shift: one describes most fisheyes, mirrors need the second.
PUPIL_COEFFICIENTS = 2
# Numbers of coefficients that the best lens is also fitted with.
OTHER_PUPIL_COEFFICIENTS = (1, 3)
# Lenses with the lowest held-out errors that are fitted with a pupil shift.
MAX_LENSES = 4


@dataclass(frozen=True)
class NonCentralSelection(Selection):
    """The selected non-central model.

    Attributes
    ----------
    central
        The central candidate to compare with: the selected central model, or the same lens without pupil shift.
    """

    central: Candidate


def fit_axial(central: Candidate, observations: Observations, coefficients: int, *, loss: Loss) -> Candidate:
    """Fit the lens of a central candidate with an entrance pupil that shifts along the axis.

    What the central candidate estimates of the lens is estimated too, under the same constraints.
    """
    start = replace(central.state, model=Axial(central.state.central_model, (0.0,) * coefficients))
    directions = block_diag(central.free_parameters.directions, np.eye(coefficients))
    free_parameters = replace(central.free_parameters, directions=np.asarray(directions, float))
    name = f"axial {central.name}, {coefficients}"
    return Candidate.fit(name, start, observations, free_parameters, loss=loss)


def select_axial(
    central: Selection, spline: Candidate | None, observations: Observations, inliers: Bools, loss: Loss
) -> NonCentralSelection:
    """Fit the best central lenses with a pupil shift, and select the best on held-out views.

    Parameters
    ----------
    central
        The central candidates; the best one fitted to all observations.
    spline
        The spline baseline, if it was fitted to all views.
    observations, inliers
        Board points and pixels, and (N,) the inliers.
    loss
        As in `refine`.
    """
    errors = [candidate.held_out_rms or candidate.rms for candidate in central.candidates]
    lenses = [c for c, px in zip(central.candidates, errors, strict=True) if px <= MAX_RMS_RATIO * errors[0]]
    lenses = lenses[:MAX_LENSES] + ([spline] if spline is not None else [])

    def fitted(lens: Candidate, coefficients: int) -> Candidate:
        axial = fit_axial(lens, observations, coefficients, loss=loss)
        validates = central.best.held_out_lengths is not None
        return axial.cross_validated(observations, inliers, loss=loss) if validates else axial

    candidates = [fitted(lens, PUPIL_COEFFICIENTS) for lens in lenses]
    first = select_model(candidates, observations, inliers, loss=loss)
    lens = lenses[[c.name for c in candidates].index(first.best.name)]
    candidates += [fitted(lens, count) for count in OTHER_PUPIL_COEFFICIENTS]
    origin = [*lenses, *[lens] * len(OTHER_PUPIL_COEFFICIENTS)]
    selection = select_model(candidates, observations, inliers, loss=loss)
    static = origin[[c.name for c in candidates].index(selection.best.name)]
    central_lens = _central_counterpart(static, central.best, observations, inliers, loss)
    return NonCentralSelection(selection.best, selection.candidates, selection.reason, central_lens)


def select_prescription(
    model: RayModel,
    central: Selection,
    observations: Observations,
    inliers: Bools,
    options: EstimationOptions,
) -> NonCentralSelection:
    """Refine a camera whose design is known, such as a lens and a mirror.

    Raises
    ------
    ValueError
        If the refined camera fits clearly worse than the central model: it is not the one of the images.
    """
    start = resect_prescription(with_wide_aperture(model, observations), observations)
    fixed = (*options.fix, *(name for name in unobservable_parameters(model) if name not in options.free))
    estimated = FreeParameters.of(start.model, fixed=fixed, free=options.free)
    free_parameters = replace(central.best.free_parameters, directions=estimated.directions)
    best = Candidate.fit(model.name, start, observations, free_parameters, loss=options.loss)
    if not best.rms <= MAX_RMS_RATIO * central.best.rms:
        raise ValueError(
            f"{model.name}: refined from the given design, the rms is {best.rms:.2f} px, that of a central"
            f" {central.best.name} {central.best.rms:.2f} px: mirror, distance or focal length differ from the design"
        )
    if central.best.held_out_lengths is not None:
        best = best.cross_validated(observations, inliers, loss=options.loss)
    assert isinstance(best.state.model, RayModel)
    refined = with_designed_aperture(best.state.model, model, best.state.points(observations)[0][inliers])
    best = replace(best, state=replace(best.state, model=refined))
    selection = select_model([best], observations, inliers)
    return NonCentralSelection(best, selection.candidates, selection.reason, central.best)


def _central_counterpart(
    lens: Candidate, best: Candidate, observations: Observations, inliers: Bools, loss: Loss
) -> Candidate:
    """Return the better of the selected central model and the same lens without pupil shift."""
    if best.held_out_lengths is None:
        return best
    lens = lens.refit(observations, inliers, loss=loss)
    if lens.held_out_lengths is None:
        lens = lens.cross_validated(observations, inliers, loss=loss)
    return min(best.scored(inliers), lens.scored(inliers), key=lambda c: c.held_out_rms or 0.0)
