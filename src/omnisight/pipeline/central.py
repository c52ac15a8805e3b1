"""The calibration of one camera from images of a plane board."""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.candidate import COMPARED, ENOUGH, Candidate
from omnisight.calibration.free_parameters import FreeParameters, squared
from omnisight.calibration.initial_camera import estimate_initial_camera
from omnisight.calibration.model_selection import (
    AUTO,
    FEW_PARAMETERS,
    HOPELESS,
    NARROW,
    NARROW_AUTO,
    TIE,
    choose,
)
from omnisight.calibration.model_starts import model_starts
from omnisight.calibration.resection import resect
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import State
from omnisight.camera import Camera
from omnisight.geometry.sphere import angle_from_axis
from omnisight.images import ImageField
from omnisight.models import CameraModel, model_names
from omnisight.optim.loss import robust_sigma
from omnisight.pipeline.result import CalibrationResult
from omnisight.quality.checks import FEWEST, same_pictures
from omnisight.quality.quality_report import assess
from omnisight.targets.observations import Observations

# Corners that begin so far from the axis (radians) leave a blind middle, as a mirror has.
BLIND = np.radians(15.0)
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Calibration(CalibrationResult):
    """A calibrated central camera, and what supports it.

    Attributes
    ----------
    camera
        The camera, with its figures, verdict and covariance.
    """

    camera: Camera


def calibrate_camera(
    views: Observations,
    size: tuple[int, int],
    *,
    model: str = "auto",
    loss: str = "huber",
    fixed: Sequence[str] = (),
    free: Sequence[str] = (),
    square: bool = False,
    flat: bool = False,
    force: bool = False,
    start: CameraModel | None = None,
    field: ImageField | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """Calibrate a camera from corners of a plane board.

    No guess of any kind is needed: lenses and mirrors from 60 to 280 degrees start by themselves.

    Parameters
    ----------
    views
        The corners of every image.
    size
        (width, height) of the images, px.
    model
        A camera model, or "auto": fit several and choose by held-out error.
    loss
        "huber", or "squared" for plain least squares.
    fixed, free
        Parameters by name that stay at their start (0 for a skew), or that move although they do not by default.
    square
        Hold pixels square: one focal length.
    flat
        Take the board as flat. Otherwise its bend is estimated, and kept if images held out are explained better.
        Points that do not lie in z = 0 are taken as they are.
    force
        Calibrate also from fewer than three images that differ.
    start
        A camera near enough to begin from, if one is known.
    field
        Where the images show anything, if that is known.
    progress
        Called with a stage, how much of it is done, and how much there is.

    Raises
    ------
    ValueError
        If the model is unknown, or the images are too few or explain no camera.
    """
    if model != "auto" and model not in model_names():
        raise ValueError(f"unknown camera model {model!r}; there are: auto, {', '.join(model_names())}")
    must_be_enough(views, force=force)
    report = progress or (lambda stage, done, total: None)
    report("start", 0, 1)
    begun = estimate_initial_camera(views, size) if start is None else resect(start, views)
    report("start", 1, 1)
    # Models are told apart by fewer corners than there may be; the one chosen is fitted to all.
    kept = views.thinned_rows(ENOUGH)
    sketch = views.at(kept)
    started = [
        found for name in _models(model, begun, views) for found in model_starts(name, begun, sketch, fixed=fixed)
    ]
    _must_be_known([*fixed, *free], [state.model for _, state in started], model)
    fitted: list[Candidate] = []
    for i, (name, state) in enumerate(started):
        report("fit", i, len(started))
        if square:
            state = dataclasses.replace(state, model=squared(state.model, fixed))
        freedom = FreeParameters.of(state.model, fixed=fixed, free=free, square=square)
        fitted.append(Candidate.fit(name, state, sketch, freedom, loss=loss, tolerance=COMPARED))
    report("fit", len(started), len(started))
    if not fitted:
        raise ValueError(f"{model} cannot describe this camera: its corners reach {_degrees(begun, views):.0f} degrees")
    sharpest = min(fitted, key=lambda c: robust_sigma(c.state.lengths(sketch)))
    usable = ~ResidualWeights.of(sharpest.state, views).outliers(sharpest.state, views)
    judged = _hold_out(fitted, sketch, usable[kept], loss, flat or not views.planar, report)
    best, reason = choose(judged, sketch, usable[kept])
    if len(kept) < len(views.pixels) and len(judged) > 1:
        reason += f" Models were compared on {len(kept)} of {len(views.pixels)} corners."
    report("judge", 0, 1)
    chosen = best.on(views, usable, loss=loss)
    others = (c for c in judged if c is not best)
    compared = chosen if chosen.corners == best.corners else best
    ranked = compared, *sorted(others, key=lambda c: (c.held_out_rms is None, c.held_out_rms or c.rms))
    found = _conclude(chosen, reason, ranked, views, size, loss, field, begun, auto=model == "auto")
    report("judge", 1, 1)
    return found


def must_be_enough(views: Observations, *, force: bool) -> None:
    """Raise ValueError if there are too few images that differ to calibrate from."""
    if len(views) >= (1 if force else FEWEST) > len(views) - len(same := same_pictures(views)) and not force:
        pairs = ", ".join(f"{a} = {b}" for a, b in same[:3]) + (", ..." if len(same) > 3 else "")
        raise ValueError(
            f"{len(views)} images with a board, but only {len(views) - len(same)} that differ ({pairs}): {FEWEST} is"
            " the least, 10 to 20 are good; move and tilt the board between images (--force calibrates all the same)"
        )
    if len(views) < (1 if force else FEWEST):
        raise ValueError(
            f"{len(views)} {'picture with a board is' if len(views) == 1 else 'pictures with a board are'} too few:"
            f" {FEWEST} is the least, 10 to 20 are good; the board tilted, and everywhere in the image"
        )


def _models(model: str, start: State, views: Observations) -> tuple[str, ...]:
    if model != "auto":
        return (model,)
    if len(views) < FEWEST:
        return FEW_PARAMETERS
    return (*AUTO, *(NARROW_AUTO if _reach(start, views) < NARROW else ()))


def _must_be_known(names: Sequence[str], models: Sequence[CameraModel], asked: str) -> None:
    known = list(dict.fromkeys(name for model in models for name in model.param_names))
    if models and (unknown := sorted(set(names) - set(known))):
        who = "none of the models has" if asked == "auto" else f"{asked} has no"
        raise ValueError(
            f"{who} {', '.join(unknown)}; {'they have' if asked == 'auto' else 'it has'} {', '.join(known)}"
        )


def _hold_out(
    fitted: Sequence[Candidate], views: Observations, usable: NDArray[np.bool_], loss: str, flat: bool, report: Progress
) -> list[Candidate]:
    """Ask every model that is not hopeless about images it has not seen, with a bent board where that is better."""
    if len(views) < FEWEST:
        return list(fitted)
    least = min(c.rms for c in fitted)
    near = [i for i, c in enumerate(fitted) if c.rms <= HOPELESS * least]
    judged = list(fitted)
    if not flat:
        scout = min(near, key=lambda i: (fitted[i].parameters, fitted[i].rms))
        judged[scout], bent = (
            candidate.held_out(views, usable, loss=loss)
            for candidate in (fitted[scout], fitted[scout].bent(views, loss=loss))
        )
        if (bent.held_out_rms or 0.0) < (1 - TIE) * (judged[scout].held_out_rms or 0.0):
            judged = [
                c if i not in near else bent if i == scout else c.bent(views, loss=loss) for i, c in enumerate(fitted)
            ]
    for done, i in enumerate(near):
        report("hold out", done, len(near))
        if judged[i].held_out_rms is None:
            judged[i] = judged[i].held_out(views, usable, loss=loss)
    report("hold out", len(near), len(near))
    return judged


def _conclude(
    best: Candidate,
    reason: str,
    ranked: tuple[Candidate, ...],
    views: Observations,
    size: tuple[int, int],
    loss: str,
    field: ImageField | None,
    scout: State,
    *,
    auto: bool,
) -> Calibration:
    state = best.state
    outliers = ResidualWeights.of(state, views).outliers(state, views)
    points, _ = state.points(views)
    shown = np.isfinite(state.residuals(views)).all(1)  # in the model's domain
    angles = angle_from_axis(points)[~outliers & shown]
    least = float(angles.min(initial=np.pi))
    camera = Camera(
        state.model,
        size,
        theta_max=float(angles.max(initial=0.0)),
        theta_min=least if least > BLIND else 0.0,
    )
    camera, trust = assess(best, camera, views, ~outliers, scout=scout, field=field, loss=loss, auto=auto)
    figures: dict[str, Any] = {
        "rms": best.rms,
        "mean": best.mean,
        "held_out_rms": best.held_out_rms,
        "images": len(views),
        "corners": len(views.pixels),
        "outliers": int(outliers.sum()),
        **trust.figures(),
    }
    if best.freedom.warp:
        figures["board_warp"] = [float(bend) for bend in state.warp]
    camera = dataclasses.replace(camera, calibration=figures)
    return Calibration(views, best, ranked, reason, outliers, trust, camera)


def _reach(state: State, views: Observations) -> float:
    points, _ = state.points(views)
    return float(angle_from_axis(points).max())


def _degrees(state: State, views: Observations) -> float:
    return float(np.degrees(_reach(state, views)))
