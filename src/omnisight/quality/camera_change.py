"""Camera change: whether two cameras explain the images better than one, and which images belong to which.

Focus, zoom or binning may change during a set, or a folder may hold images of two cameras. The scores of the views, the
gradients of the camera parameters with their poses eliminated, then point in opposite directions (tests of parameter
constancy: Zeileis and Hornik, Generalized M-fluctuation tests for parameter instability, Statistica Neerlandica 61,
2007). The splits by file name, the best split by order and the best split into any two clusters are refitted and
compared with one camera by the Bayesian information criterion, a view being one sample.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.bundle_adjustment import Bundle
from omnisight.calibration.candidate import Candidate
from omnisight.calibration.covariance import parts_by_view, view_scatter
from omnisight.calibration.estimation_options import Loss
from omnisight.calibration.residual_weights import MIN_SIGMA_PX, ResidualWeights
from omnisight.calibration.rotation_alignment import rotation_aligned_difference
from omnisight.calibration.state import State
from omnisight.display import Displayed
from omnisight.images.name_patterns import patterns_by_name
from omnisight.models import Projector
from omnisight.quality.image_orientation import find_orientation
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

# Views of each of the two cameras: three determine one, and a fourth tests it.
MIN_VIEWS_EACH = 4
# Decrease of the criterion that is very strong evidence (Kass and Raftery, Bayes factors, Journal of the American
# Statistical Association 90, 1995).
MIN_EVIDENCE = 10.0
# Share of the gain of two cameras that one camera with some images mirrored may lack, because it has fewer parameters.
MAX_LOST_GAIN = 0.1
# Error (px) that a change causes in a good and in a usable camera.
MAX_CHANGE_ERROR_PX = (0.5, 2.0)


@dataclass(frozen=True)
class CameraChange(Displayed):
    """Two cameras that explain the images better than one.

    Attributes
    ----------
    is_second
        (V,) which views belong to the second camera.
    names
        Names of the images.
    patterns
        Patterns of the file names, one for each camera, if the names divide the images in the same way; else empty.
    orientation
        How the images of the second camera were changed, such as "mirrored", if this alone makes the difference; or "".
    in_order
        Whether all images of the second camera follow those of the first.
    evidence
        Decrease of the Bayesian information criterion; twice the logarithm of the Bayes factor.
    rms
        Root mean square residual of the two cameras, px.
    difference
        Root mean square difference of the two cameras at the corners after the best rotation, px.
    magnification
        Magnification of the second camera relative to the first.
    shift
        Distance of their principal points, px.
    """

    is_second: Bools
    names: tuple[str, ...]
    patterns: tuple[str, ...]
    orientation: str
    in_order: bool
    evidence: float
    rms: float
    difference: float
    magnification: float
    shift: float

    @property
    def error(self) -> float:
        """Error of the camera of all images, px: about half of the difference."""
        return self.difference / 2

    @property
    def first_changed(self) -> str:
        """Name of the first image of the second camera."""
        return self.names[int(np.argmax(self.is_second))]

    def as_dict(self) -> dict[str, object]:
        """Return the figures by name."""
        return {
            "in_order": self.in_order,
            "patterns": list(self.patterns),
            "orientation": self.orientation,
            "second_camera": list(self.names_of(second=True)),
            "evidence": self.evidence,
            "difference_px": self.difference,
            "magnification": self.magnification,
            "shift_px": self.shift,
        }

    def names_of(self, second: bool) -> tuple[str, ...]:
        """Return the names of the images of one camera."""
        return tuple(name for name, is_second in zip(self.names, self.is_second, strict=True) if is_second == second)


def find_camera_change(candidate: Candidate, observations: Observations, *, loss: Loss) -> CameraChange | None:
    """Return the two cameras that explain the images better than one; None if one camera does, or there are few views.

    Parameters
    ----------
    candidate
        The model fitted to all views.
    observations
        All views.
    loss
        As in `refine`.
    """
    views = len(observations)
    if views < 2 * MIN_VIEWS_EACH or not candidate.parameters:
        return None
    scores = _whitened_scores(candidate, observations, loss)
    # Length of the description of a split, in nats: one of the splits by name, one of V positions, or a label per view.
    by_name = _splits_by_name(observations.names)
    splits = [(is_second, np.log(len(by_name)), patterns) for is_second, patterns in by_name]
    splits += [(_best_split_in_order(scores), np.log(views), ()), (_best_clusters(scores), views * np.log(2), ())]
    camera_cost = candidate.free_parameters.count * np.log(views)
    changes = list[tuple[CameraChange, State]]()
    for is_second, split_cost, patterns in splits:
        penalty = camera_cost + 2 * split_cost
        if is_second is None or _linear_gain(scores, is_second) < penalty + MIN_EVIDENCE:
            continue
        gain, states = _refitted_gain(candidate, observations, is_second, loss)
        if gain >= penalty + MIN_EVIDENCE:
            change = _describe(states, candidate, observations, is_second, gain - penalty)
            changes.append((replace(change, patterns=patterns), states[0]))
    if not changes:
        return None
    change, first = max(changes, key=lambda item: item[0].evidence)
    return replace(change, orientation=_orientation(change, first, candidate, observations, loss))


def _whitened_scores(candidate: Candidate, observations: Observations, loss: Loss) -> Array:
    """Return the scores of the views (V, F) in units in which their information adds up to the identity matrix."""
    weights = ResidualWeights.estimate(candidate.state, observations, loss)
    problem = Bundle(observations, candidate.free_parameters, weights)
    _, gradients = parts_by_view(problem, candidate.state)
    return gradients @ problem.linearize(candidate.state).half_covariance() / max(weights.sigma, MIN_SIGMA_PX)


def _linear_gain(scores: Array, is_second: Bools) -> float:
    """Return the decrease of chi squared by a second camera for some of the views, to first order."""
    share = is_second.mean()
    return float(((scores[is_second] - scores.mean(0)).sum(0) ** 2).sum() / (share * (1 - share)))


def _splits_by_name(names: Sequence[str]) -> list[tuple[Bools, tuple[str, ...]]]:
    """Return splits (V,) of one pattern of the file names from the others, with all patterns."""
    splits = list[tuple[Bools, tuple[str, ...]]]()
    for patterns in map(np.array, patterns_by_name(names)):
        distinct = tuple(dict.fromkeys(patterns.tolist()))
        for pattern in distinct[1:]:
            is_second = patterns == pattern
            if min(is_second.sum(), (~is_second).sum()) >= MIN_VIEWS_EACH:
                splits.append((is_second, distinct))
    return splits


def _best_split_in_order(scores: Array) -> Bools:
    """Return the split (V,) into first and second views of the greatest gain."""
    order = np.arange(len(scores))
    splits = [order >= k for k in range(MIN_VIEWS_EACH, len(scores) - MIN_VIEWS_EACH + 1)]
    return max(splits, key=lambda split: _linear_gain(scores, split))


def _best_clusters(scores: Array) -> Bools | None:
    """Return the clusters (V,) of the greatest gain, by alternation from the principal direction; None if too small."""
    centred = scores - scores.mean(0)
    direction = np.linalg.svd(centred, full_matrices=False)[2][0]
    is_second = centred @ direction > 0
    for _ in range(len(scores)):
        if min(is_second.sum(), (~is_second).sum()) < MIN_VIEWS_EACH:
            return None
        following = centred[is_second].sum(0)
        if np.allclose(following, direction):
            break
        direction = following
        is_second = centred @ direction > 0
    return is_second ^ is_second[0]  # the first view belongs to the first camera


def _refitted_gain(
    candidate: Candidate, observations: Observations, is_second: Bools, loss: Loss
) -> tuple[float, tuple[State, State]]:
    """Return the decrease of chi squared by refitting both parts, and their states.

    Chi squared is relative to the residuals and to the scatter between the views that remain within the parts: what
    all images have in common, such as a board that bends, is no evidence for two cameras. The larger scatter counts,
    because few views hardly scatter about a camera fitted to them.
    """
    weights = ResidualWeights.estimate(candidate.state, observations, loss)
    parts = [np.flatnonzero(~is_second), np.flatnonzero(is_second)]
    second, first = candidate.leave_out(parts, observations, weights)  # each without the other part
    remaining, measured, scatter = 0.0, 0, list[float]()
    for views, state in zip(parts, (first, second), strict=True):
        part = observations.subset(views)
        problem = Bundle(part, candidate.free_parameters, weights.subset(observations.rows(views)))
        remaining += 2 * problem.cost(state)
        measured += part.pixels.size - candidate.free_parameters.count - candidate.free_parameters.per_view * len(part)
        scatter.append(view_scatter(replace(candidate, state=state), part))
    total = 2 * Bundle(observations, candidate.free_parameters, weights).cost(candidate.state)
    variance = remaining / max(measured, 1) * max(*scatter, 1.0)
    return (total - remaining) / max(variance, MIN_SIGMA_PX**2), (first, second)


def _orientation(
    change: CameraChange, first: State, candidate: Candidate, observations: Observations, loss: Loss
) -> str:
    """Return the orientation of the second images if with it one camera keeps most of the gain of two cameras."""
    weights = ResidualWeights.estimate(candidate.state, observations, loss)
    cost = Bundle(observations, candidate.free_parameters, weights).cost(candidate.state)
    share = (change.rms / candidate.rms) ** 2
    return find_orientation(
        first, observations, change.is_second, weights, cost * (share + MAX_LOST_GAIN * (1 - share))
    )


def _describe(
    states: tuple[State, State], candidate: Candidate, observations: Observations, is_second: Bools, evidence: float
) -> CameraChange:
    parts = [observations.subset(np.flatnonzero(part)) for part in (~is_second, is_second)]
    lengths = np.concatenate([state.lengths(part) for state, part in zip(states, parts, strict=True)])
    points, _ = candidate.state.points(observations)
    (pixels, first), (others, second) = (_projections(state.model, points) for state in states)
    difference = np.linalg.norm(rotation_aligned_difference(states[1].model, points, pixels), axis=1)
    radii = [np.nanmedian(np.linalg.norm(p - centre, axis=1)) for p, centre in ((pixels, first), (others, second))]
    return CameraChange(
        is_second,
        tuple(observations.names),
        patterns=(),
        orientation="",
        in_order=bool(is_second[np.argmax(is_second) :].all()),
        evidence=float(evidence),
        rms=float(np.sqrt((lengths**2).mean())),
        difference=float(np.sqrt(np.nanmean(difference**2))),
        magnification=float(radii[1] / radii[0]),
        shift=float(np.linalg.norm(second - first)),
    )


def _projections(model: Projector, points: Array) -> tuple[Array, Array]:
    """Return the pixels (N, 2) of points (N, 3), and the principal point."""
    return model.project_numpy(points)[0], model.project_numpy(np.array([[0.0, 0.0, 1.0]]))[0][0]
