"""Fitting camera models to the same boards, and choosing one by the pictures it has not seen."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.initialise import restart
from omnisight.calibrate.refine import State, free_params, refine
from omnisight.calibrate.views import BoardViews
from omnisight.models import CameraModel, model_class
from omnisight.models.ocam import Ocam

Array = NDArray[np.float64]

AUTO = ("unified", "eucm", "double_sphere", "kannala_brandt", "mei", "ocam")
FEW_PARAMETERS = ("unified", "eucm", "double_sphere")
NARROW_AUTO = ("radial_tangential",)
NARROW = np.radians(62.0)
OCAM_DEGREES = (3, 4, 5, 6)
FOLDS = 5
# A model is not asked about pictures it has not seen where it explains those it has so much worse than the best.
HOPELESS = 1.5
# Held-out figures this close are the same: the model with fewer parameters is taken.
TIE = 0.01


@dataclass(frozen=True)
class Candidate:
    """A camera model fitted to all pictures.

    Attributes
    ----------
    name
        The model, with its degree where it has one.
    state
        Camera and poses.
    parameters
        How many of the camera's parameters were estimated.
    rms, mean
        Length of the residual over all corners, px.
    held_out_rms
        The same over pictures that the camera was not calibrated on (k-fold, their poses free, corners that no model
        explains left out), px; None where it was not asked for.
    free
        Which parameters were estimated (P,).
    """

    name: str
    state: State
    parameters: int
    rms: float
    mean: float
    held_out_rms: float | None
    free: NDArray[np.bool_]

    def as_dict(self) -> dict[str, float | str | int | None]:
        """Give the figures by name."""
        return {
            "model": self.name,
            "parameters": self.parameters,
            "rms": self.rms,
            "mean": self.mean,
            "held_out_rms": self.held_out_rms,
        }


def starts_of(name: str, start: State, views: BoardViews) -> list[tuple[str, State]]:
    """Give the camera model of that name fitted to the start's directions; the polynomial in each of its degrees."""
    if name != "ocam":
        state = restart(start, model_class(name), views)
        return [] if state is None else [(name, state)]
    points, _ = start.points(views)
    found: list[tuple[str, State]] = []
    for degree in OCAM_DEGREES:
        model = Ocam.start_of_degree(points, views.pixels, degree)
        found.append((f"ocam degree {degree}", State(model, start.rotations, start.translations)))
    return found


def fit_candidate(
    name: str, start: State, views: BoardViews, *, loss: str, fixed: Sequence[str], free: Sequence[str]
) -> Candidate:
    """Refine one model on all pictures."""
    moving = freed(start.model, fixed, free)
    state = refine(start, views, free=moving, loss=loss).state
    lengths = state.lengths(views)
    return Candidate(
        name,
        state,
        int(moving.sum()),
        float(np.sqrt((lengths**2).mean())),
        float(lengths.mean()),
        None,
        moving,
    )


def freed(model: CameraModel, fixed: Sequence[str], free: Sequence[str]) -> NDArray[np.bool_]:
    """Say which parameters move (P,); names that the model lacks are passed over."""
    still, moving = (np.array([name in names for name in model.param_names]) for names in (fixed, free))
    return (free_params(model) & ~still) | moving


def held_out_rms(candidate: Candidate, views: BoardViews, usable: NDArray[np.bool_], *, loss: str) -> float:
    """Give the rms (px) over pictures left out (k-fold): the camera from the others, their own poses free."""
    count = len(views)
    folds = min(FOLDS, count)
    squares, corners = 0.0, 0
    none = np.zeros_like(candidate.free)
    for fold in range(folds):
        test = np.arange(fold, count, folds)
        train = np.setdiff1d(np.arange(count), test)
        trained = refine(
            _part(candidate.state, train), views.subset(train), free=candidate.free, loss=loss, tolerance=1e-6
        ).state
        seen = views.subset(test)
        part = _part(candidate.state, test)
        posed = refine(State(trained.model, part.rotations, part.translations), seen, free=none, loss=loss).state
        use = np.concatenate([usable[views.groups[i]] for i in test])
        lengths = posed.lengths(seen)[use]
        squares, corners = squares + float((lengths**2).sum()), corners + len(lengths)
    return float(np.sqrt(squares / max(corners, 1)))


def choose(candidates: Sequence[Candidate]) -> tuple[Candidate, str]:
    """Give the best candidate and one sentence that says why."""
    asked = [c for c in candidates if c.held_out_rms is not None]
    if not asked:
        best = min(candidates, key=lambda c: (round(c.rms, 3), c.parameters))
        return (
            best,
            f"{best.name}: too few pictures to hold any out, so the least rms decides ({best.rms:.3f} px).",
        )
    lowest = min(asked, key=lambda c: c.held_out_rms or 0)
    near = [c for c in asked if (c.held_out_rms or 0) <= (1 + TIE) * (lowest.held_out_rms or 0)]
    best = min(near, key=lambda c: (c.parameters, c.held_out_rms or 0))
    others = [c for c in asked if c is not best]
    figure = f"{best.held_out_rms:.3f} px on pictures it was not calibrated on"
    if not others and len(candidates) > 1:
        worse = f"{HOPELESS:g} times worse"
        return best, f"{best.name}: {figure}; the others explain even those they were calibrated on {worse}."
    if not others:
        return best, f"{best.name}: {figure}."
    second = min(others, key=lambda c: c.held_out_rms or 0)
    if best is not lowest:
        why = (
            f"as good as {lowest.name} ({lowest.held_out_rms:.3f} px) within {TIE:.0%}, with {best.parameters}"
            f" parameters instead of {lowest.parameters}"
        )
    else:
        why = f"the least of {len(asked)}; next is {second.name} with {second.held_out_rms:.3f} px"
    return best, f"{best.name}: {figure}, {why}."


def _part(state: State, views: NDArray[np.intp]) -> State:
    return State(state.model, state.rotations[views], state.translations[views])
