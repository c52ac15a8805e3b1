"""A candidate camera model: fitted to all views, refitted and cross-validated."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.bundle_adjustment import Bundle, refine
from omnisight.calibration.estimation_options import Loss
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.resection import has_pose_outlier, reresect
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import State
from omnisight.display import Displayed
from omnisight.models import CameraModel
from omnisight.optim.levenberg_marquardt import minimize
from omnisight.optim.schur import GroupedNormal
from omnisight.optim.tolerances import COARSE_TOLERANCE, COMPARISON_TOLERANCE, FINAL_TOLERANCE
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

# Corners and views that suffice to compare models; the selected model is refitted to all of them.
MAX_COMPARED_CORNERS = 1500
# Views that suffice to fit a model of a hundred parameters for comparison.
MAX_COMPARED_VIEWS = 60
# Folds of the cross-validation: each model is fitted to four fifths of the views.
FOLDS = 5
# Decrease of the cost per parameter, in variances, at which the refit to a fold stops: leaving out a fold lowers the
# cost by about a tenth of a variance or more, whatever the number of corners.
FOLD_TOLERANCE = 0.005
# Initial damping of the refit to a fold, which starts next to its minimum.
FOLD_DAMPING = 1e-12


@dataclass(frozen=True)
class Candidate(Displayed):
    """A camera model fitted to observations.

    Attributes
    ----------
    name
        The model, with its variant (such as the degree) if it has several.
    state
        Camera, poses and board warp.
    free_parameters
        What was estimated.
    corners
        Number of corners it was fitted to.
    rms, mean
        Root mean square and mean residual length over these corners, px.
    held_out_rms
        Root mean square residual length of the inliers in held-out views, px; None without cross-validation.
    held_out_lengths
        (N,) residual length of every corner when its view is held out, px.
    probability
        Probability that it predicts further views best among the candidates; None without cross-validation.
    """

    name: str
    state: State
    free_parameters: FreeParameters
    corners: int
    rms: float
    mean: float
    held_out_rms: float | None = None
    held_out_lengths: Array | None = None
    probability: float | None = None

    @property
    def parameters(self) -> int:
        """Number of estimated camera parameters."""
        return self.free_parameters.directions.shape[1]

    def as_dict(self) -> dict[str, float | str | int | None]:
        """Return the figures by name."""
        return {
            "model": self.name,
            "parameters": self.parameters,
            "corners": self.corners,
            "rms": self.rms,
            "mean": self.mean,
            "held_out_rms": self.held_out_rms,
            "probability": self.probability,
        }

    @classmethod
    def fit(
        cls,
        name: str,
        start: State,
        observations: Observations,
        free_parameters: FreeParameters,
        *,
        loss: Loss,
        tolerance: float = FINAL_TOLERANCE,
    ) -> "Candidate":
        """Fit a model to all views; once more with new poses if a view may have ended in a wrong pose."""

        def refined(state: State) -> State:
            solution = refine(state, observations, free_parameters=free_parameters, loss=loss, tolerance=tolerance)
            return solution.state

        state = refined(start)
        if loss != "squared" and isinstance(state.model, CameraModel) and has_pose_outlier(state, observations):
            other = refined(reresect(state, observations))
            weights = ResidualWeights.estimate(other, observations, loss)
            state = min(other, state, key=Bundle(observations, free_parameters, weights).cost)
        return cls.from_state(name, state, observations, free_parameters)

    @classmethod
    def from_state(
        cls, name: str, state: State, observations: Observations, free_parameters: FreeParameters
    ) -> "Candidate":
        """Return the candidate of a fitted state."""
        lengths = state.lengths(observations)
        return cls(name, state, free_parameters, len(lengths), _rms(lengths), float(lengths.mean()))

    def with_board_warp(self, observations: Observations, *, loss: Loss) -> "Candidate":
        """Return the candidate refitted with the board warp among the free parameters."""
        free_parameters = replace(self.free_parameters, warp=True)
        return self.fit(self.name, self.state, observations, free_parameters, loss=loss, tolerance=COMPARISON_TOLERANCE)

    def refit(self, observations: Observations, inliers: Bools, *, loss: Loss) -> "Candidate":
        """Return the candidate refitted to all corners, cross-validated on them if it was before."""
        fitted = self.fit(self.name, self.state, observations, self.free_parameters, loss=loss)
        fitted = replace(fitted, probability=self.probability)
        if len(observations.pixels) == self.corners:
            return replace(fitted, held_out_rms=self.held_out_rms, held_out_lengths=self.held_out_lengths)
        return fitted if self.held_out_rms is None else fitted.cross_validated(observations, inliers, loss=loss)

    def cross_validated(self, observations: Observations, inliers: Bools, *, loss: Loss) -> "Candidate":
        """Return the candidate with its k-fold held-out error: camera and warp from the other views, own poses free."""
        folds = [np.arange(k, len(observations), FOLDS) for k in range(min(FOLDS, len(observations)))]
        weights = ResidualWeights.estimate(self.state, observations, loss)
        lengths = np.empty(len(observations.pixels))
        for fold, trained in zip(folds, self.leave_out(folds, observations, weights), strict=True):
            rows = observations.rows(fold)
            start = replace(self.state.subset(fold), model=trained.model, warp=trained.warp)
            own = self.free_parameters.without_camera()
            lengths[rows] = _pose_residuals(start, observations.subset(fold), weights.subset(rows), own)
        return replace(self, held_out_lengths=lengths).scored(inliers)

    def scored(self, inliers: Bools) -> "Candidate":
        """Return the candidate with the held-out error over these inliers (N,)."""
        assert self.held_out_lengths is not None
        return replace(self, held_out_rms=_rms(self.held_out_lengths[inliers]) if inliers.any() else None)

    def leave_out(
        self, folds: Sequence[NDArray[np.intp]], observations: Observations, weights: ResidualWeights
    ) -> Iterator[State]:
        """Yield the state refitted without each of the folds of the views, which partition them.

        The normal equations of all folds but one add up to those of the first step.
        """
        parts = [self._bundle(fold, observations, weights).corner_normal(self.state.subset(fold)) for fold in folds]
        for held_out in range(len(folds)):
            others = [i for i in range(len(folds)) if i != held_out]
            views = np.concatenate([folds[i] for i in others])
            problem, start = self._bundle(views, observations, weights), self.state.subset(views)
            first = problem.with_priors(GroupedNormal.joined([parts[i] for i in others]), start)
            tolerance = FOLD_TOLERANCE * max(self.free_parameters.count, 1) / len(problem.observations.pixels)
            yield minimize(
                problem, start, tolerance=tolerance, scale=problem.scale, damping=FOLD_DAMPING, first=first
            ).state

    def _bundle(self, views: NDArray[np.intp], observations: Observations, weights: ResidualWeights) -> Bundle:
        return Bundle(observations.subset(views), self.free_parameters, weights.subset(observations.rows(views)))

    def subsampled(self, observations: Observations, inliers: Bools) -> tuple["Candidate", Observations, Bools]:
        """Return candidate, observations and inliers reduced to what suffices for a comparison."""
        count = min(len(observations), MAX_COMPARED_VIEWS)
        views = np.unique(np.linspace(0, len(observations) - 1, count).round().astype(np.intp))
        part = observations.subset(views)
        kept = part.thinned_rows(MAX_COMPARED_CORNERS)
        rows = observations.rows(views)[kept]
        lengths = None if self.held_out_lengths is None else self.held_out_lengths[rows]
        candidate = replace(self, state=self.state.subset(views), held_out_lengths=lengths)
        return candidate, part.at(kept), inliers[rows]


def _pose_residuals(
    start: State, observations: Observations, weights: ResidualWeights, free_parameters: FreeParameters
) -> Array:
    """Pose held-out views with a given camera and warp, and return the residual lengths (N,), px."""
    posed = refine(
        start, observations, free_parameters=free_parameters, weights=weights, tolerance=COARSE_TOLERANCE
    ).state
    return posed.lengths(observations)


def _rms(lengths: Array) -> float:
    return float(np.sqrt((lengths**2).mean()))
