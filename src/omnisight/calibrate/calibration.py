"""The calibration of one camera from pictures of a plane board."""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.candidates import (
    AUTO,
    FEW_PARAMETERS,
    HOPELESS,
    NARROW,
    NARROW_AUTO,
    Candidate,
    choose,
    fit_candidate,
    held_out_rms,
    starts_of,
)
from omnisight.calibrate.initialise import initialise, posed
from omnisight.calibrate.refine import Bundle, State, robust_threshold, weight_roots
from omnisight.calibrate.views import BoardViews
from omnisight.calibrate.warn import doubts
from omnisight.camera import Camera
from omnisight.models import CameraModel, model_names
from omnisight.optim.loss import Huber, robust_sigma

Array = NDArray[np.float64]

Progress = Callable[[str, int, int], None]
FEWEST_VIEWS = 3


@dataclass(frozen=True)
class Calibration:
    """A calibrated camera, and what supports it.

    Attributes
    ----------
    camera
        The camera, with its figures and covariance.
    state
        Its model with cam_from_board of every picture.
    views
        The corners it was calibrated on.
    candidates
        Every model that was fitted, best first.
    reason
        One sentence: why this model.
    rms, mean, held_out_rms
        Length of the residual, px: over all corners, and over pictures held out (None with too few pictures).
    outliers
        (N,) corners more than five robust standard deviations off.
    warnings
        What to doubt, a sentence each.
    """

    camera: Camera
    state: State
    views: BoardViews
    candidates: tuple[Candidate, ...]
    reason: str
    rms: float
    mean: float
    held_out_rms: float | None
    outliers: NDArray[np.bool_]
    warnings: tuple[str, ...]

    @property
    def residual_lengths(self) -> Array:
        """(N,) length of each corner's residual, px."""
        return self.state.lengths(self.views)


def calibrate_camera(
    views: BoardViews,
    size: tuple[int, int],
    *,
    model: str = "auto",
    loss: str = "huber",
    fixed: Sequence[str] = (),
    free: Sequence[str] = (),
    force: bool = False,
    start: CameraModel | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """Calibrate a camera from corners of a plane board.

    No guess of any kind is needed: lenses and mirrors from 60 to 280 degrees start by themselves.

    Parameters
    ----------
    views
        The corners of every picture.
    size
        (width, height) of the pictures, px.
    model
        A camera model, or "auto": fit several and choose by held-out error.
    loss
        "huber", or "squared" for plain least squares.
    fixed, free
        Parameters by name that stay at their start (0 for a skew), or that move although they do not by default.
    force
        Calibrate also from fewer than three pictures.
    start
        A camera near enough to begin from, if one is known.
    progress
        Called with a stage, how much of it is done, and how much there is.

    Raises
    ------
    ValueError
        If the model is unknown, or the pictures are too few or explain no camera.
    """
    if model != "auto" and model not in model_names():
        raise ValueError(f"unknown camera model {model!r}; there are: auto, {', '.join(model_names())}")
    must_be_enough(views, force=force)
    report = progress or (lambda stage, done, total: None)
    report("start", 0, 1)
    begun = initialise(views, size) if start is None else posed(start, views)
    report("start", 1, 1)
    started = [found for name in _models(model, begun, views) for found in starts_of(name, begun, views)]
    _must_be_known([*fixed, *free], [state.model for _, state in started], model)
    fitted: list[Candidate] = []
    for i, (name, state) in enumerate(started):
        report("fit", i, len(started))
        fitted.append(fit_candidate(name, state, views, loss=loss, fixed=fixed, free=free))
    if not fitted:
        raise ValueError(f"{model} cannot describe this camera: its corners reach {_degrees(begun, views):.0f} degrees")
    judged = _hold_out(fitted, views, loss, report)
    best, reason = choose(judged)
    ranked = sorted(judged, key=lambda c: (c.held_out_rms is None, c.held_out_rms or c.rms))
    return _conclude(best, reason, tuple(ranked), views, size, auto=model == "auto")


def must_be_enough(views: BoardViews, *, force: bool) -> None:
    """Raise ValueError if there are too few pictures to calibrate from."""
    if len(views) < (1 if force else FEWEST_VIEWS):
        raise ValueError(
            f"{len(views)} pictures with a board are too few: {FEWEST_VIEWS} is the least, 10 to 20 are good;"
            " the board tilted, and everywhere in the picture"
        )


def _models(model: str, start: State, views: BoardViews) -> tuple[str, ...]:
    if model != "auto":
        return (model,)
    if len(views) < FEWEST_VIEWS:
        return FEW_PARAMETERS
    return (*AUTO, *(NARROW_AUTO if _reach(start, views) < NARROW else ()))


def _must_be_known(names: Sequence[str], models: Sequence[CameraModel], asked: str) -> None:
    known = list(dict.fromkeys(name for model in models for name in model.param_names))
    if models and (unknown := sorted(set(names) - set(known))):
        who = "none of the models has" if asked == "auto" else f"{asked} has no"
        raise ValueError(
            f"{who} {', '.join(unknown)}; {'they have' if asked == 'auto' else 'it has'} {', '.join(known)}"
        )


def _hold_out(fitted: Sequence[Candidate], views: BoardViews, loss: str, report: Progress) -> list[Candidate]:
    if len(views) < FEWEST_VIEWS:
        return list(fitted)
    sharpest = min(fitted, key=lambda c: robust_sigma(c.state.lengths(views)))
    usable = ~_outliers(sharpest.state, views)
    least = min(c.rms for c in fitted)
    judged: list[Candidate] = []
    for i, candidate in enumerate(fitted):
        report("hold out", i, len(fitted))
        if candidate.rms <= HOPELESS * least:
            held_out = held_out_rms(candidate, views, usable, loss=loss)
            candidate = dataclasses.replace(candidate, held_out_rms=held_out)
        judged.append(candidate)
    report("hold out", len(fitted), len(fitted))
    return judged


def _conclude(
    best: Candidate,
    reason: str,
    ranked: tuple[Candidate, ...],
    views: BoardViews,
    size: tuple[int, int],
    *,
    auto: bool,
) -> Calibration:
    state = best.state
    outliers = _outliers(state, views)
    points, _ = state.points(views)
    shown = np.isfinite(state.residuals(views)).all(1)  # in the model's domain
    angles = np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2])
    figures = {
        "rms": best.rms,
        "mean": best.mean,
        "held_out_rms": best.held_out_rms,
        "pictures": len(views),
        "corners": len(views.pixels),
        "outliers": int(outliers.sum()),
    }
    camera = Camera(
        state.model,
        size,
        theta_max=float(angles[~outliers & shown].max(initial=0.0)),
        calibration=figures,
        covariance=_covariance(best, views),
    )
    return Calibration(
        camera,
        state,
        views,
        ranked,
        reason,
        best.rms,
        best.mean,
        best.held_out_rms,
        outliers,
        doubts(state, views, auto=auto),
    )


def _outliers(state: State, views: BoardViews) -> NDArray[np.bool_]:
    roots = weight_roots(state, views)
    return state.lengths(views, roots) > robust_threshold(state, views, roots)


def _covariance(best: Candidate, views: BoardViews) -> Array:
    """Give the covariance (P, P) of the camera's parameters, zero for those that stood still."""
    roots = weight_roots(best.state, views)
    threshold = robust_threshold(best.state, views, roots)
    normal = Bundle(views, Huber(threshold), best.free, roots).linearise(best.state)
    sigma = robust_sigma(best.state.lengths(views, roots))
    covariance = np.zeros((len(best.free), len(best.free)))
    covariance[np.ix_(best.free, best.free)] = sigma**2 * normal.shared_covariance()
    return covariance


def _reach(state: State, views: BoardViews) -> float:
    points, _ = state.points(views)
    return float(np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2]).max())


def _degrees(state: State, views: BoardViews) -> float:
    return float(np.degrees(_reach(state, views)))
