"""The calibration of a camera whose rays need not meet in a point, from pictures of plane boards."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.candidates import HOPELESS, Candidate, choose
from omnisight.calibrate.freedom import Freedom
from omnisight.calibrate.rays.drawing import as_drawn, idle, placed, whole
from omnisight.calibrate.rays.fitting import axial_of, clearly_better, fit, with_rays
from omnisight.calibrate.spread import Spread
from omnisight.calibrate.state import State
from omnisight.calibrate.trust.checks import CHECKS, EVERY
from omnisight.calibrate.trust.covariance import camera_covariance
from omnisight.calibrate.trust.evidence import Evidence
from omnisight.calibrate.trust.uncertainty import UncertaintyMap
from omnisight.calibrate.trust.verdict import Verdict
from omnisight.calibrate.views import BoardViews
from omnisight.camera import Camera
from omnisight.geometry.sphere import angle_from_axis
from omnisight.optics.models.axial import Axial
from omnisight.optics.ray_model import RayModel
from omnisight.ray_camera import RayCamera

if TYPE_CHECKING:
    from omnisight.calibrate.calibration import Calibration

Array = NDArray[np.float64]

# Coefficients of the place on the axis that are tried: first for every lens, then for the best.
FIRST, OTHERS = 2, (1, 3)
# Lenses that are tried.
LENSES = 4


@dataclass(frozen=True)
class RaysCalibration:
    """A calibrated camera of rays, and what supports it.

    Attributes
    ----------
    camera
        The camera, with its figures and covariance.
    state
        Its model with cam_from_board of every picture, and the bend of the board.
    views
        The corners it was calibrated on.
    candidates
        The chosen one, then the others, best first.
    central
        The central camera it is compared with.
    needed
        Whether it explains pictures held out better than the central one by more than chance.
    reason
        One sentence: why this camera.
    outliers
        (N,) corners more than five robust standard deviations off.
    verdict
        Whether to use it, and what to do where not.
    """

    camera: RayCamera
    state: State
    views: BoardViews
    candidates: tuple[Candidate, ...]
    central: Candidate
    needed: bool
    reason: str
    outliers: NDArray[np.bool_]
    verdict: Verdict

    @property
    def rms(self) -> float:
        """Root mean square length of the residual over all corners, px."""
        return self.candidates[0].rms

    @property
    def held_out_rms(self) -> float | None:
        """The same over pictures held out; None with too few pictures."""
        return self.candidates[0].held_out_rms


def calibrate_rays(
    calibration: "Calibration",
    model: str | RayModel = "axial",
    *,
    unit: str = "squares",
    fixed: Sequence[str] = (),
    free: Sequence[str] = (),
    loss: str = "huber",
) -> RaysCalibration:
    """Calibrate a non-central camera from the boards of a central calibration.

    Parameters
    ----------
    calibration
        The central calibration of the same pictures: where it starts, and what it is compared with.
    model
        "axial": the lenses of the central candidates with a viewpoint that moves along their axis; the one that
        explains pictures held out best is taken. Or a camera that is nearly known, such as a `Catadioptric` of a
        mirror's drawing: it is refined, with the parameters that it frees.
    unit
        Of the boards: "m", or "squares" where their size is not known.
    fixed, free
        Parameters by name of a camera to start from that stay there, or that move although they do not by default: the
        lens and where the mirror stands do, its shape does not. Of an axial one is estimated what the central
        calibration estimated.
    loss
        "huber", or "squared".

    Raises
    ------
    ValueError
        If there is no such model, or the camera to start from explains too few corners, or does not come near.
    """
    views, usable, central = calibration.views, ~calibration.outliers, calibration.candidates[0]
    if isinstance(model, RayModel):
        tried = [_refined(calibration, model, fixed, free, loss)]
    elif model == "axial":
        tried = _axial(calibration, loss)
    else:
        raise ValueError(f"unknown non-central model {model!r}; give 'axial', or a camera of rays to start from")
    best, reason = choose(tried, views, usable)
    needed = best.held_out_lengths is None or clearly_better(best, central, views, usable)
    if not needed:
        reason += f" The central {central.name} has {central.held_out_rms:.3f} px: nothing here asks for more."
    return _concluded(best, tuple(tried), calibration, needed, reason, unit, loss)


def _refined(
    calibration: "Calibration", model: RayModel, fixed: Sequence[str], free: Sequence[str], loss: str
) -> Candidate:
    """Refine a camera that is nearly known."""
    views, usable, central = calibration.views, ~calibration.outliers, calibration.candidates[0]
    start = placed(whole(model, views), views)
    still = (*fixed, *(name for name in idle(model) if name not in free))
    freedom = Freedom.of(start.model, fixed=still, free=free, warp=central.freedom.warp)
    found = fit(model.name, start, views, freedom, loss=loss)
    if not found.rms <= HOPELESS * central.rms:
        raise ValueError(
            f"{model.name}: refined from the camera to start from, it is {found.rms:.2f} px off, a central"
            f" {central.name} {central.rms:.2f} px: its mirror, distance or focal length is not what was drawn"
        )
    found = _judged(found, calibration, loss)
    ended = as_drawn(cast(RayModel, found.state.model), model, found.state.points(views)[0][usable])
    return replace(found, state=with_rays(found.state, ended))


def _axial(calibration: "Calibration", loss: str) -> list[Candidate]:
    """Let the viewpoints of the best central cameras and of a spline move, the best of these in other ways too."""
    views, central = calibration.views, calibration.candidates
    figure = [candidate.held_out_rms or candidate.rms for candidate in central]
    near = [c for c, px in zip(central, figure, strict=True) if px <= HOPELESS * figure[0]][:LENSES]
    spline = calibration.trust.ceiling
    if spline is not None and len(spline.candidate.state.rotations) == len(views):
        near.append(spline.candidate)
    tried = [_judged(axial_of(lens, views, FIRST, loss=loss), calibration, loss) for lens in near]
    best, _ = choose(tried, views, ~calibration.outliers)
    lens = near[[candidate is best for candidate in tried].index(True)]
    tried += [_judged(axial_of(lens, views, count, loss=loss), calibration, loss) for count in OTHERS]
    return tried


def _judged(candidate: Candidate, calibration: "Calibration", loss: str) -> Candidate:
    if calibration.candidates[0].held_out_lengths is None:
        return candidate
    return candidate.held_out(calibration.views, ~calibration.outliers, loss=loss)


def _concluded(
    best: Candidate,
    tried: tuple[Candidate, ...],
    calibration: "Calibration",
    needed: bool,
    reason: str,
    unit: str,
    loss: str,
) -> RaysCalibration:
    views, state, central = calibration.views, best.state, calibration.candidates[0]
    outliers = Spread.of(state, views).doubtful(state, views)
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
        "pictures": len(views),
        "corners": len(views.pixels),
        "outliers": int(outliers.sum()),
    }
    # The middle that a mirror's central camera may not see is not the middle of its lens.
    first = float(np.nanmin(angles)) if calibration.camera.theta_min or not isinstance(model, Axial) else 0.0
    last = float(np.nanmax(angles))
    if isinstance(model, Axial):
        figures["travel"] = model.travel(first, last)
    camera = RayCamera(
        model,
        calibration.camera.size,
        unit,
        theta_max=last,
        theta_min=first,
        covariance=camera_covariance(best, views, loss=loss),
    )
    verdict = _judge(best, camera, calibration, outliers)
    figures |= {"verdict": str(verdict), "reasons": list(verdict.reasons)}
    ranked = sorted(tried, key=lambda c: (c is not best, c.held_out_rms is None, c.held_out_rms or c.rms))
    camera = replace(camera, calibration=figures)
    return RaysCalibration(camera, state, views, tuple(ranked), central, needed, reason, outliers, verdict)


def _judge(best: Candidate, camera: RayCamera, calibration: "Calibration", outliers: NDArray[np.bool_]) -> Verdict:
    """Judge it as a central camera is judged; how sure it is of what is far where its bearings are a lens's."""
    trust, far, asked = calibration.trust, calibration.camera, EVERY
    uncertainty, model = trust.uncertainty, camera.model
    if isinstance(model, Axial) and camera.covariance is not None:
        count = model.lens.params.size
        far = Camera(
            model.lens,
            camera.size,
            theta_max=camera.theta_max,
            theta_min=camera.theta_min,
            covariance=camera.covariance[:count, :count],
        )
        uncertainty, asked = UncertaintyMap.of(far), CHECKS
    views = calibration.views
    evidence = Evidence(far, best, views, uncertainty, trust.coverage, None, None, None, outliers, auto=True)
    return Verdict.of(evidence, asked)
