"""Fitting camera models to the same boards, and choosing one by the pictures it has not seen."""

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.freedom import STRETCH, Freedom
from omnisight.calibrate.initialise import repose
from omnisight.calibrate.refine import Bundle, refine
from omnisight.calibrate.restart import pairs, restart
from omnisight.calibrate.spread import Spread
from omnisight.calibrate.state import State
from omnisight.calibrate.views import BoardViews
from omnisight.geometry.sphere import angle_from_axis
from omnisight.models import model_class
from omnisight.models.ocam import Ocam
from omnisight.models.spline import Spline
from omnisight.optim.levenberg_marquardt import minimise
from omnisight.optim.schur import GroupedNormal

Array = NDArray[np.float64]

AUTO = ("unified", "eucm", "double_sphere", "kannala_brandt", "mei", "ocam")
FEW_PARAMETERS = ("unified", "eucm", "double_sphere")
NARROW_AUTO = ("radial_tangential",)
NARROW = np.radians(62.0)
OCAM_DEGREES = (3, 4, 5, 6)
# Spans of the spline's profile; corners from which on its correction has 5x5 cells, not 3x3.
SPANS, MANY = 10, 800
FOLDS = 5
# Corners that are enough to compare cameras by, and pictures where many parameters are to be fitted to each.
ENOUGH, ENOUGH_PICTURES = 1500, 60
FOLD_TOLERANCE, POSE_TOLERANCE = 1e-5, 1e-4
# A model is not asked about pictures it has not seen where it explains those it has so much worse than the best.
HOPELESS = 1.5
# Held-out figures this close are the same: the model with fewer parameters is taken.
TIE = 0.01
# Angle from the axis (radians) within which a polynomial is any, if no corner lies there.
UNSEEN = np.radians(20)
# Floors of valleys this close are one floor, reached from several sides.
LEVEL = 1e-5
# A view whose corners lie so many times farther off than those of the others may be posed wrongly.
ASTRAY = 4.0
# An image should go on for so many times the angle that corners reach.
ROOM = 1.03


@dataclass(frozen=True)
class Candidate:
    """A camera model fitted to all pictures.

    Attributes
    ----------
    name
        The model, with its degree where it has one.
    state
        Camera, poses and bend of the board.
    freedom
        What was estimated.
    corners
        How many it was fitted to.
    rms, mean
        Length of the residual over all of these, px.
    held_out_rms
        The same over pictures that the camera was not calibrated on (k-fold, their poses free, corners that no model
        explains left out), px; None where it was not asked for.
    held_out_lengths
        (N,) those residuals, px, corner by corner.
    """

    name: str
    state: State
    freedom: Freedom
    corners: int
    rms: float
    mean: float
    held_out_rms: float | None = None
    held_out_lengths: Array | None = None

    @property
    def parameters(self) -> int:
        """How many of the camera's parameters were estimated."""
        return self.freedom.directions.shape[1]

    def as_dict(self) -> dict[str, float | str | int | None]:
        """Give the figures by name."""
        return {
            "model": self.name,
            "parameters": self.parameters,
            "corners": self.corners,
            "rms": self.rms,
            "mean": self.mean,
            "held_out_rms": self.held_out_rms,
        }

    @classmethod
    def fit(cls, name: str, start: State, views: BoardViews, freedom: Freedom, *, loss: str) -> "Candidate":
        """Refine one model on all pictures; again with boards posed anew, if some ended where they do not belong."""
        state = refine(start, views, freedom=freedom, loss=loss).state
        if _astray(state, views) and loss != "squared":
            healed = refine(repose(state, views), views, freedom=freedom, loss=loss).state
            spread = Spread.of(healed, views, loss)
            state = min(healed, state, key=Bundle(views, Freedom.none(state.model), spread).cost)
        return cls.found(name, state, views, freedom)

    @classmethod
    def found(cls, name: str, state: State, views: BoardViews, freedom: Freedom) -> "Candidate":
        """Give what a fit has found."""
        lengths = state.lengths(views)
        return cls(name, state, freedom, len(lengths), float(np.sqrt((lengths**2).mean())), float(lengths.mean()))

    def bent(self, views: BoardViews, *, loss: str) -> "Candidate":
        """Refine it again with a board that may be bent."""
        return self.fit(self.name, self.state, views, dataclasses.replace(self.freedom, warp=True), loss=loss)

    def on(self, views: BoardViews, usable: NDArray[np.bool_], *, loss: str) -> "Candidate":
        """Give it fitted to, and judged by, all corners of its views; itself where it was."""
        if len(views.pixels) == self.corners:
            return self
        found = self.fit(self.name, self.state, views, self.freedom, loss=loss)
        return found if self.held_out_rms is None else found.held_out(views, usable, loss=loss)

    def held_out(self, views: BoardViews, usable: NDArray[np.bool_], *, loss: str) -> "Candidate":
        """Give it with the rms over pictures left out (k-fold): camera and board from the others, own poses free."""
        folds = [np.arange(k, len(views), FOLDS) for k in range(min(FOLDS, len(views)))]
        spread = Spread.of(self.state, views, loss)
        lengths = np.empty(len(views.pixels))
        for fold, trained in zip(folds, self.without(folds, views, spread), strict=True):
            rows = views.rows(fold)
            lengths[rows] = posed_by(trained, self.state.part(fold), views.subset(fold), spread.part(rows))
        rms = float(np.sqrt((lengths[usable] ** 2).mean())) if usable.any() else None
        return dataclasses.replace(self, held_out_rms=rms, held_out_lengths=lengths)

    def sketched(
        self, views: BoardViews, usable: NDArray[np.bool_]
    ) -> tuple["Candidate", BoardViews, NDArray[np.bool_]]:
        """Give it with no more views and corners than are enough to compare it with another camera."""
        some = np.unique(np.linspace(0, len(views) - 1, ENOUGH_PICTURES).round().astype(np.intp))
        part = views.subset(some)
        kept = part.thinned_rows(ENOUGH)
        rows = views.rows(some)[kept]
        lengths = None if self.held_out_lengths is None else self.held_out_lengths[rows]
        sketch = dataclasses.replace(self, state=self.state.part(some), held_out_lengths=lengths)
        return sketch, part.at(kept), usable[rows]

    def without(self, folds: Sequence[NDArray[np.intp]], views: BoardViews, spread: Spread) -> Iterator[State]:
        """Refine it without each of the folds of the views in turn, the other corners counting as among all.

        The normal equations of the folds add up: those of all but one tell most of the way from the state of all.
        """
        parts = [self._problem(fold, views, spread).of_corners(self.state.part(fold)) for fold in folds]
        for left_out in range(len(folds)):
            others = [i for i in range(len(folds)) if i != left_out]
            some = np.concatenate([folds[i] for i in others])
            problem, start = self._problem(some, views, spread), self.state.part(some)
            normal = problem.completed(GroupedNormal.joined([parts[i] for i in others]), start.model)
            step = normal.solve(0.0)
            if np.isfinite(step).all():
                start = min(start, problem.move(start, step), key=problem.cost)
            yield minimise(problem, start, tolerance=FOLD_TOLERANCE, scale=problem.scale).state

    def _problem(self, some: NDArray[np.intp], views: BoardViews, spread: Spread) -> Bundle:
        return Bundle(views.subset(some), self.freedom, spread.part(views.rows(some)))


@dataclass(frozen=True)
class Compared:
    """Candidates beside each other.

    Attributes
    ----------
    ranked
        The chosen one, then the others, the best on pictures held out first.
    views
        The corners they were fitted to.
    usable
        (N,) those of them that the sharpest explains.
    """

    ranked: tuple[Candidate, ...]
    views: BoardViews
    usable: NDArray[np.bool_]


def _astray(state: State, views: BoardViews) -> bool:
    """Say whether a view's corners lie so much farther off than those of others that its pose may be a wrong one."""
    lengths = state.lengths(views)
    medians = [float(np.median(lengths[rows])) for rows in views.groups]
    return max(medians) > ASTRAY * float(np.median(medians))


def posed_by(trained: State, start: State, views: BoardViews, spread: Spread) -> Array:
    """Pose views by a camera and board that did not see them, and give the length (px) of each residual (N,)."""
    start = dataclasses.replace(start, model=trained.model, warp=trained.warp)
    still = Freedom.none(trained.model)
    return refine(start, views, freedom=still, spread=spread, tolerance=POSE_TOLERANCE).state.lengths(views)


def starts_of(name: str, start: State, views: BoardViews, *, fixed: Sequence[str] = ()) -> list[tuple[str, State]]:
    """Give the camera model of that name fitted to the start's directions; the polynomial in each of its degrees."""
    if name == "spline":
        return [(name, spline_start(start, views))]
    if name != "ocam":
        state = restart(start, model_class(name), views, fixed=fixed)
        return [] if state is None else [(name, state)]
    # What no corner shows of the middle leaves several valleys.
    several = float(angle_from_axis(start.points(views)[0]).min(initial=np.pi)) > UNSEEN
    shown = [pairs(start, views, inwards=inwards) for inwards in ((False, True) if several else (False,))]
    states, spread = list[State](), Spread.of(start, views)
    for degree in OCAM_DEGREES:
        fresh = [dataclasses.replace(start, model=Ocam.start_of_degree(*seen, degree)) for seen in shown]
        states.append(_polynomial_start(degree, fresh, states[-1] if states else None, views, spread))
    return [(f"ocam degree {degree}", state) for degree, state in zip(OCAM_DEGREES, states, strict=True)]


def _polynomial_start(
    degree: int, fresh: Sequence[State], lower: State | None, views: BoardViews, spread: Spread
) -> State:
    """Give the best of polynomials fitted to a start and, where that is nearer, of what one degree less finds."""
    starts = list(fresh)
    if lower is not None:
        still = Freedom.of(lower.model, fixed=STRETCH)
        found = refine(lower, views, freedom=still, spread=spread, tolerance=FOLD_TOLERANCE).state
        starts.append(dataclasses.replace(found, model=Ocam.from_dict(found.model.to_dict() | {f"a{degree}": 0.0})))
    ends = starts
    if len(fresh) > 1:  # only their floors tell valleys apart
        ends = [refine(end, views, spread=spread).state for end in starts]
    cost = Bundle(views, Freedom.none(starts[0].model), spread).cost
    floors = [cost(end) for end in ends]
    lowest = [begun for begun, floor in zip(starts, floors, strict=True) if floor <= (1 + LEVEL) * min(floors)]
    return min(lowest, key=cost)


def spline_start(start: State, views: BoardViews) -> State:
    """Give a spline fitted to the start's directions, as fine as so many corners can tell."""
    points, pixels = pairs(start, views)
    model = Spline.start_of(points, pixels, SPANS, 3 if len(views.pixels) < MANY else 5)
    return dataclasses.replace(start, model=model)


def choose(candidates: Sequence[Candidate], views: BoardViews, usable: NDArray[np.bool_]) -> tuple[Candidate, str]:
    """Give the best candidate and one sentence that says why.

    Of those that are as good as the best on pictures held out, the one with the fewest parameters: whose mean square is
    above by no more than its standard error over the pictures (Breiman et al., Classification and regression trees,
    1984, sec. 3.4.3), both asked about the same pictures. A model whose image folds over just past the corners comes
    last: what lies a little farther out it cannot see at all.
    """
    judged = [c for c in candidates if c.held_out_rms is not None]
    asked = [c for c in judged if not _folds(c, views, usable)] or judged
    if not asked:
        best = min(candidates, key=lambda c: (round(c.rms, 3), c.parameters))
        return (
            best,
            f"{best.name}: too few pictures to hold any out, so the least rms decides ({best.rms:.3f} px).",
        )
    lowest = min(asked, key=lambda c: c.held_out_rms or 0)
    near = [c for c in asked if _as_good(c, lowest, views, usable)]
    best = min(near, key=lambda c: (c.parameters, c.held_out_rms or 0))
    others = [c for c in asked if c is not best]
    figure = f"{best.held_out_rms:.3f} px on pictures it was not calibrated on"
    if not others and len(candidates) > 1:
        worse = f"{HOPELESS:g} times worse"
        return best, f"{best.name}: {figure}; the others explain even those they were calibrated on {worse}."
    if not others:
        return best, f"{best.name}: {figure}."
    second = min(others, key=lambda c: c.held_out_rms or 0)
    passed = min(judged, key=lambda c: c.held_out_rms or 0)
    if passed not in asked:
        why = f"the least of those that do not fold over past the corners, as {passed.name} does"
    elif best is not lowest:
        why = (
            f"as good as {lowest.name} ({lowest.held_out_rms:.3f} px) as far as so many pictures can tell, with"
            f" {best.parameters} parameters instead of {lowest.parameters}"
        )
    else:
        why = f"the least of {len(asked)}; next is {second.name} with {second.held_out_rms:.3f} px"
    return best, f"{best.name}: {figure}, {why}."


def _folds(candidate: Candidate, views: BoardViews, usable: NDArray[np.bool_]) -> bool:
    angles = angle_from_axis(candidate.state.points(views)[0])[usable]
    return candidate.state.model.theta_max < min(ROOM * float(angles.max(initial=0.0)), np.pi)


def _as_good(candidate: Candidate, lowest: Candidate, views: BoardViews, usable: NDArray[np.bool_]) -> bool:
    if (candidate.held_out_rms or 0) <= (1 + TIE) * (lowest.held_out_rms or 0):
        return True
    if candidate.held_out_lengths is None or lowest.held_out_lengths is None:
        return False
    worse = np.where(usable, candidate.held_out_lengths**2 - lowest.held_out_lengths**2, 0.0)
    by_view = np.bincount(views.view_of_row, worse, len(views))
    return bool(by_view.mean() <= by_view.std(ddof=1) / np.sqrt(len(views)))
