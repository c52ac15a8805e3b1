"""The calibration of a camera whose rays need not meet in a point, from images of plane boards."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.axial import axial_of, clearly_better, fit, with_rays
from omnisight.calibration.candidate import Candidate
from omnisight.calibration.covariance import camera_covariance
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.model_selection import HOPELESS, choose
from omnisight.calibration.prescription import as_drawn, idle, placed, whole
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.camera import Camera
from omnisight.geometry.sphere import angle_from_axis
from omnisight.images import ImageField
from omnisight.models import CameraModel
from omnisight.optics.models.axial import Axial
from omnisight.optics.ray_model import RayModel
from omnisight.pipeline.result import CalibrationResult
from omnisight.quality.central_limit import far_camera, from_viewpoint
from omnisight.quality.coverage import Coverage
from omnisight.quality.evidence import Evidence
from omnisight.quality.noncentral_test import compared, evaluate_noncentrality
from omnisight.quality.split_half import run_split_half_test
from omnisight.quality.uncertainty import UncertaintyMap
from omnisight.quality.verdict import Verdict
from omnisight.ray_camera import RayCamera

if TYPE_CHECKING:
    from omnisight.pipeline.central import Calibration
    from omnisight.quality.quality_report import QualityReport

Array = NDArray[np.float64]

# Coefficients of the place on the axis that are tried: first for every lens, then for the best.
FIRST, OTHERS = 2, (1, 3)
# Lenses that are tried.
LENSES = 4


@dataclass(frozen=True)
class RaysCalibration(CalibrationResult):
    """A calibrated camera of rays, and what supports it.

    Of what is far it is sure as a central camera is, and by it two halves of the images are compared; its viewpoint
    is compared with that of the central one. None but a central camera has a spline beside it.

    Attributes
    ----------
    camera
        The camera, with its figures and covariance.
    central
        The best central camera beside it: the one that was chosen, or its own lens with a viewpoint that stands still.
    needed
        Whether it explains images held out better than the central one by more than chance.
    """

    camera: RayCamera
    central: Candidate
    needed: bool


def calibrate_rays(
    calibration: "Calibration",
    model: str | RayModel = "axial",
    *,
    unit: str = "squares",
    fixed: Sequence[str] = (),
    free: Sequence[str] = (),
    loss: str = "huber",
    field: ImageField | None = None,
) -> RaysCalibration:
    """Calibrate a non-central camera from the boards of a central calibration.

    Parameters
    ----------
    calibration
        The central calibration of the same images: where it starts, and what it is compared with.
    model
        "axial": the lenses of the central candidates with a viewpoint that moves along their axis; the one that
        explains images held out best is taken. Or a camera that is nearly known, such as a `Catadioptric` of a
        mirror's drawing: it is refined, with the parameters that it frees.
    unit
        Of the boards: "m", or "squares" where their size is not known.
    fixed, free
        Parameters by name of a camera to start from that stay there, or that move although they do not by default: the
        lens and where the mirror stands do, its shape does not. Of an axial one is estimated what the central
        calibration estimated.
    loss
        "huber", or "squared".
    field
        Where the images show anything, if that is known.

    Raises
    ------
    ValueError
        If there is no such model, or the camera to start from explains too few corners, or does not come near.
    """
    views, usable = calibration.views, ~calibration.outliers
    if isinstance(model, RayModel):
        tried = [(_refined(calibration, model, fixed, free, loss), calibration.chosen)]
    elif model == "axial":
        tried = _axial(calibration, loss)
    else:
        raise ValueError(f"unknown non-central model {model!r}; give 'axial', or a camera of rays to start from")
    best, reason = choose([found for found, _ in tried], views, usable)
    central = _rival(next(still for found, still in tried if found is best), calibration, loss)
    needed = best.held_out_lengths is None or clearly_better(best, central, views, usable)
    if not needed:
        reason += f" The central {central.name} has {central.held_out_rms:.3f} px: nothing here asks for more."
    others = sorted(
        (found for found, _ in tried if found is not best),
        key=lambda c: (c.held_out_rms is None, c.held_out_rms or c.rms),
    )
    return _concluded((best, *others), central, calibration, needed, reason, unit, loss, field)


def _refined(
    calibration: "Calibration", model: RayModel, fixed: Sequence[str], free: Sequence[str], loss: str
) -> Candidate:
    """Refine a camera that is nearly known."""
    views, usable, central = calibration.views, ~calibration.outliers, calibration.chosen
    start = placed(whole(model, views), views)
    still = (*fixed, *(name for name in idle(model) if name not in free))
    free_parameters = FreeParameters.of(start.model, fixed=still, free=free, warp=central.free_parameters.warp)
    found = fit(model.name, start, views, free_parameters, loss=loss)
    if not found.rms <= HOPELESS * central.rms:
        raise ValueError(
            f"{model.name}: refined from the camera to start from, it is {found.rms:.2f} px off, a central"
            f" {central.name} {central.rms:.2f} px: its mirror, distance or focal length is not what was drawn"
        )
    found = _judged(found, calibration, loss)
    ended = as_drawn(cast(RayModel, found.state.model), model, found.state.points(views)[0][usable])
    return replace(found, state=with_rays(found.state, ended))


def _axial(calibration: "Calibration", loss: str) -> list[tuple[Candidate, Candidate]]:
    """Let the viewpoints of the best central cameras and of a spline move, the best of these in other ways too.

    With each comes the central camera that it was.
    """
    views, central = calibration.views, calibration.candidates
    figure = [candidate.held_out_rms or candidate.rms for candidate in central]
    near = [c for c, px in zip(central, figure, strict=True) if px <= HOPELESS * figure[0]][:LENSES]
    spline = calibration.trust.spline_baseline
    if spline is not None and len(spline.candidate.state.rotations) == len(views):
        near.append(spline.candidate)
    tried = [(_judged(axial_of(lens, views, FIRST, loss=loss), calibration, loss), lens) for lens in near]
    best, _ = choose([found for found, _ in tried], views, ~calibration.outliers)
    lens = next(lens for found, lens in tried if found is best)
    return tried + [(_judged(axial_of(lens, views, count, loss=loss), calibration, loss), lens) for count in OTHERS]


def _rival(still: Candidate, calibration: "Calibration", loss: str) -> Candidate:
    """Give the central camera to compare with: the same lens, its viewpoint standing still, or the one chosen."""
    chosen, usable = calibration.chosen, ~calibration.outliers
    if chosen.held_out_lengths is None:
        return chosen
    still = still.on(calibration.views, usable, loss=loss)
    if still.held_out_rms is None:
        still = _judged(still, calibration, loss)
    return min(_counting(chosen, usable), _counting(still, usable), key=lambda c: c.held_out_rms or 0.0)


def _counting(candidate: Candidate, usable: NDArray[np.bool_]) -> Candidate:
    """Give it with what it is off by on images held out, of the corners that count here."""
    assert candidate.held_out_lengths is not None
    return replace(candidate, held_out_rms=float(np.sqrt((candidate.held_out_lengths[usable] ** 2).mean())))


def _judged(candidate: Candidate, calibration: "Calibration", loss: str) -> Candidate:
    if calibration.chosen.held_out_lengths is None:
        return candidate
    return candidate.held_out(calibration.views, ~calibration.outliers, loss=loss)


def _concluded(
    ranked: tuple[Candidate, ...],
    central: Candidate,
    calibration: "Calibration",
    needed: bool,
    reason: str,
    unit: str,
    loss: str,
    field: ImageField | None,
) -> RaysCalibration:
    best, views = ranked[0], calibration.views
    state = best.state
    outliers = ResidualWeights.estimate(state, views).outliers(state, views)
    model = cast(RayModel, state.model)
    bearings = model.rays(views.pixels[~outliers])[1]
    angles = angle_from_axis(bearings)
    figures: dict[str, Any] = {
        "rms": best.rms,
        "mean": best.mean,
        "held_out_rms": best.held_out_rms,
        "central": central.name,
        "central_held_out_rms": central.held_out_rms,
        "needed": needed,
        "images": len(views),
        "corners": len(views.pixels),
        "outliers": int(outliers.sum()),
    }
    # The middle that a mirror's central camera may not see is not the middle of its lens.
    first = float(np.nanmin(angles)) if calibration.camera.theta_min or not isinstance(model, Axial) else 0.0
    last = float(np.nanmax(angles))
    if isinstance(model, Axial):
        figures["travel"] = model.pupil_shift(first, last)
    camera = RayCamera(
        model,
        calibration.camera.size,
        unit,
        theta_max=last,
        theta_min=first,
        covariance=camera_covariance(best, views, loss=loss),
    )
    trust = _trust(best, central, camera, calibration, outliers, field, loss)
    camera = replace(camera, calibration=figures | trust.figures())
    return RaysCalibration(views, best, ranked, reason, outliers, trust, camera, central, needed)


def _trust(
    best: Candidate,
    central: Candidate,
    camera: RayCamera,
    calibration: "Calibration",
    outliers: NDArray[np.bool_],
    field: ImageField | None,
    loss: str,
) -> "QualityReport":
    """Say how far it can be trusted: of what is far as a central camera is, of what is near beside one."""
    views, model, far = calibration.views, camera.model, far_camera(camera)
    uncertainty = UncertaintyMap.of(far, field=field)
    around = from_viewpoint(best.state, model, views.pixels[~outliers])
    coverage = Coverage.of(far, around, views, field)
    viewpoint = evaluate_noncentrality(calibration, unit=camera.unit)
    if isinstance(model, Axial) and best.held_out_lengths is not None:
        ceiling = calibration.trust.spline_baseline
        viewpoint = compared(central, best, camera, views, ~calibration.outliers, ceiling)
    halves = run_split_half_test(best, views, lambda m, c: _far(camera, m, c), loss=loss)
    evidence = Evidence(far, best, views, uncertainty, coverage, halves, None, None, outliers, auto=True)
    return replace(
        calibration.trust,
        uncertainty=uncertainty,
        coverage=coverage,
        halves=halves,
        ceiling=None,
        viewpoint=viewpoint,
        verdict=Verdict.of(evidence),
    )


def _far(camera: RayCamera, model: CameraModel, covariance: Array) -> Camera:
    """Give the central camera that another model of the rays would be to a far scene."""
    return far_camera(replace(camera, model=cast(RayModel, model), covariance=covariance))
