"""A camera model fitted to boards, and asked about images that it has not seen."""

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.bundle_adjustment import Bundle, refine
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.resection import has_pose_outlier, reresect
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import State
from omnisight.optim.levenberg_marquardt import minimize
from omnisight.optim.schur import GroupedNormal
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# Corners that are enough to compare cameras by; images, where one has a hundred parameters.
ENOUGH, ENOUGH_PICTURES = 1500, 60
FOLDS = 5
# Share of the cost that steps must gain where a model is fitted to the end, where models are compared, and where boards
# held out are posed.
FITTED, COMPARED, POSED = 1e-9, 1e-5, 1e-3
# What steps must gain for each parameter, in variances, where a model is fitted to some of the images from where it
# was with all: that gains about a tenth of a variance or more, however many corners there are. The first damping there.
TOLD, NEAR = 0.005, 1e-12


@dataclass(frozen=True)
class Candidate:
    """A camera model fitted to all images.

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
        The same over images that the camera was not calibrated on (k-fold, their poses free, corners that no model
        explains left out), px; None where it was not asked for.
    held_out_lengths
        (N,) those residuals, px, corner by corner.
    """

    name: str
    state: State
    freedom: FreeParameters
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
    def fit(
        cls,
        name: str,
        start: State,
        views: Observations,
        freedom: FreeParameters,
        *,
        loss: str,
        tolerance: float = FITTED,
    ) -> "Candidate":
        """Refine one model on all images; again with boards posed anew, if some ended where they do not belong."""
        state = refine(start, views, freedom=freedom, loss=loss, tolerance=tolerance).state
        if has_pose_outlier(state, views) and loss != "squared":
            healed = refine(reresect(state, views), views, freedom=freedom, loss=loss, tolerance=tolerance).state
            spread = ResidualWeights.of(healed, views, loss)
            state = min(healed, state, key=Bundle(views, freedom, spread).cost)
        return cls.found(name, state, views, freedom)

    @classmethod
    def found(cls, name: str, state: State, views: Observations, freedom: FreeParameters) -> "Candidate":
        """Give what a fit has found."""
        lengths = state.lengths(views)
        return cls(name, state, freedom, len(lengths), float(np.sqrt((lengths**2).mean())), float(lengths.mean()))

    def bent(self, views: Observations, *, loss: str) -> "Candidate":
        """Refine it again with a board that may be bent."""
        freedom = dataclasses.replace(self.freedom, warp=True)
        return self.fit(self.name, self.state, views, freedom, loss=loss, tolerance=COMPARED)

    def on(self, views: Observations, usable: NDArray[np.bool_], *, loss: str) -> "Candidate":
        """Give it fitted to the end to all corners of its views, and judged by them."""
        found = self.fit(self.name, self.state, views, self.freedom, loss=loss)
        if len(views.pixels) == self.corners:
            return dataclasses.replace(found, held_out_rms=self.held_out_rms, held_out_lengths=self.held_out_lengths)
        return found if self.held_out_rms is None else found.held_out(views, usable, loss=loss)

    def held_out(self, views: Observations, usable: NDArray[np.bool_], *, loss: str) -> "Candidate":
        """Give it with the rms over images left out (k-fold): camera and board from the others, own poses free."""
        folds = [np.arange(k, len(views), FOLDS) for k in range(min(FOLDS, len(views)))]
        spread = ResidualWeights.of(self.state, views, loss)
        lengths = np.empty(len(views.pixels))
        for fold, trained in zip(folds, self.without(folds, views, spread), strict=True):
            rows = views.rows(fold)
            lengths[rows] = held_out_residual_lengths(
                trained, self.state.part(fold), views.subset(fold), spread.part(rows)
            )
        rms = float(np.sqrt((lengths[usable] ** 2).mean())) if usable.any() else None
        return dataclasses.replace(self, held_out_rms=rms, held_out_lengths=lengths)

    def sketched(
        self, views: Observations, usable: NDArray[np.bool_]
    ) -> tuple["Candidate", Observations, NDArray[np.bool_]]:
        """Give it with no more views and corners than are enough to compare it with a camera of many parameters."""
        some = np.unique(np.linspace(0, len(views) - 1, ENOUGH_PICTURES).round().astype(np.intp))
        part = views.subset(some)
        kept = part.thinned_rows(ENOUGH)
        rows = views.rows(some)[kept]
        lengths = None if self.held_out_lengths is None else self.held_out_lengths[rows]
        sketch = dataclasses.replace(self, state=self.state.part(some), held_out_lengths=lengths)
        return sketch, part.at(kept), usable[rows]

    def without(
        self, folds: Sequence[NDArray[np.intp]], views: Observations, spread: ResidualWeights
    ) -> Iterator[State]:
        """Refine it without each of the folds of the views in turn, the other corners counting as among all.

        The normal equations of the folds at the state of all add up to those of all but one.
        """
        parts = [self._problem(fold, views, spread).of_corners(self.state.part(fold)) for fold in folds]
        for left_out in range(len(folds)):
            others = [i for i in range(len(folds)) if i != left_out]
            some = np.concatenate([folds[i] for i in others])
            problem, start = self._problem(some, views, spread), self.state.part(some)
            first = problem.completed(GroupedNormal.joined([parts[i] for i in others]), start)
            tolerance = TOLD * max(self.freedom.count, 1) / len(problem.views.pixels)
            yield minimize(problem, start, tolerance=tolerance, scale=problem.scale, damping=NEAR, first=first).state

    def _problem(self, some: NDArray[np.intp], views: Observations, spread: ResidualWeights) -> Bundle:
        return Bundle(views.subset(some), self.freedom, spread.part(views.rows(some)))


def held_out_residual_lengths(trained: State, start: State, views: Observations, spread: ResidualWeights) -> Array:
    """Pose views by a camera and board that did not see them, and give the length (px) of each residual (N,)."""
    start = dataclasses.replace(start, model=trained.model, warp=trained.warp)
    still = FreeParameters.none(trained.model)
    return refine(start, views, freedom=still, spread=spread, tolerance=POSED).state.lengths(views)
