"""Model selection: candidate models are fitted, cross-validated and compared on held-out views."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.board_bend import run_board_bend_test
from omnisight.calibration.board_bend_estimation import estimate_board_bends, with_board_bends, with_half_held_out
from omnisight.calibration.candidate import Candidate
from omnisight.calibration.estimation_options import EstimationOptions, Loss
from omnisight.calibration.free_parameters import FreeParameters, with_square_pixels
from omnisight.calibration.model_averaging import expected_errors, not_rejected, with_probabilities
from omnisight.calibration.multistart import model_starts
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import MIN_OUTSIDE_COST_PX, State
from omnisight.display import Displayed
from omnisight.extensions import did_you_mean
from omnisight.geometry.sphere import angle_from_axis
from omnisight.models import CameraModel
from omnisight.optim.loss import robust_sigma
from omnisight.optim.tolerances import COMPARISON_TOLERANCE
from omnisight.progress import Progress
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

# Views with different poses that determine a camera: a plane gives two constraints per view on five parameters.
MIN_VIEWS = 3
# Ratio of two rms errors above which one model fits clearly worse and is not compared any further.
MAX_RMS_RATIO = 1.5
# Relative reduction of the held-out error that matters: below, the model with fewer parameters is taken.
MIN_RELATIVE_GAIN = 0.01
# Significance of a reduction that selects between models: one standard error (Breiman et al., Classification and
# Regression Trees, 1984, sec. 3.4.3).
SELECTION_SIGNIFICANCE = 0.16
# Significance of a reduction at which a camera is called non-central, and another model is advised.
CLAIM_SIGNIFICANCE = 0.01
# Factor by which the injective domain of a model must exceed the angle that corners cover. A spline ends at 1.05.
MIN_DOMAIN_MARGIN = 1.03


@dataclass(frozen=True)
class Selection(Displayed):
    """The selected model among the candidates.

    Attributes
    ----------
    best
        The selected candidate.
    candidates
        All candidates: the selected one, then the others by held-out error.
    reason
        One sentence that states why it was selected.
    """

    best: Candidate
    candidates: tuple[Candidate, ...]
    reason: str


def fit_candidates(
    models: Sequence[str], initial: State, observations: Observations, options: EstimationOptions, progress: Progress
) -> list[Candidate]:
    """Fit every model, in all its variants, from the initial camera.

    Raises
    ------
    ValueError
        If no model can represent the initial camera, or a parameter in `fix` or `free` does not exist.
    """
    starts = [start for name in models for start in model_starts(name, initial, observations, fixed=options.fix)]
    if not starts:
        angle = np.degrees(angle_from_axis(initial.points(observations)[0]).max())
        raise ValueError(f"{', '.join(models)} cannot represent this camera: corners reach {angle:.0f}° off-axis")
    _check_parameter_names([*options.fix, *options.free], [start.model for _, start in starts])
    candidates: list[Candidate] = []
    for i, (name, start) in enumerate(starts):
        progress("fit models", i, len(starts))
        if options.square_pixels and isinstance(start.model, CameraModel):
            start = replace(start, model=with_square_pixels(start.model, options.fix))
        free_parameters = FreeParameters.of(
            start.model, fixed=options.fix, free=options.free, square=options.square_pixels
        )
        candidates.append(
            Candidate.fit(name, start, observations, free_parameters, loss=options.loss, tolerance=COMPARISON_TOLERANCE)
        )
    progress("fit models", len(starts), len(starts))
    return candidates


def find_inliers(candidates: Sequence[Candidate], fitted: Observations, observations: Observations) -> Bools:
    """Return the inliers (N,) of the most precise candidate; the corners that every comparison uses."""
    sharpest = min(candidates, key=lambda c: robust_sigma(c.state.lengths(fitted)))
    return ~ResidualWeights.estimate(sharpest.state, observations).outliers(sharpest.state, observations)


def cross_validate(
    candidates: Sequence[Candidate],
    observations: Observations,
    inliers: Bools,
    options: EstimationOptions,
    progress: Progress,
) -> list[Candidate]:
    """Cross-validate every competitive candidate, with board warp if that lowers the held-out error."""
    if len(observations) < MIN_VIEWS:
        return list(candidates)
    least = min(c.rms for c in candidates)
    competitive = [i for i, c in enumerate(candidates) if c.rms <= MAX_RMS_RATIO * least]
    validated = list(candidates)
    if not options.flat and observations.is_planar:
        # The simplest competitive model decides about the warp for all.
        simplest = min(competitive, key=lambda i: (candidates[i].parameters, candidates[i].rms))
        flat, warped = (
            candidate.cross_validated(observations, inliers, loss=options.loss)
            for candidate in (
                candidates[simplest],
                candidates[simplest].with_board_warp(observations, loss=options.loss),
            )
        )
        validated[simplest] = flat
        if is_better(warped, flat, observations, inliers):
            for i in competitive:
                validated[i] = candidates[i].with_board_warp(observations, loss=options.loss)
            validated[simplest] = warped
        if sigma := _confirmed_bend_sigma(validated[simplest], observations, inliers, options.loss):
            for i in competitive:
                validated[i] = with_board_bends(validated[i], observations, sigma, loss=options.loss)
    for done, i in enumerate(competitive):
        progress("cross-validate", done, len(competitive))
        if validated[i].held_out_rms is None:
            validated[i] = validated[i].cross_validated(observations, inliers, loss=options.loss)
    progress("cross-validate", len(competitive), len(competitive))
    return validated


def _confirmed_bend_sigma(candidate: Candidate, observations: Observations, inliers: Bools, loss: Loss) -> float:
    """Return the standard deviation of bends of the board that lower the error of held-out corners; 0 if none do."""
    test = run_board_bend_test(candidate.state, observations)
    if test is None or not test.is_positive:
        return 0.0
    bent = estimate_board_bends(candidate, observations, loss=loss)
    one, other = (with_half_held_out(c, observations, loss=loss) for c in (bent, candidate))
    is_confirmed = is_better(one, other, observations, inliers, CLAIM_SIGNIFICANCE)
    return bent.free_parameters.bend_sigma if is_confirmed else 0.0


def select_model(
    candidates: Sequence[Candidate], observations: Observations, inliers: Bools, *, loss: Loss = "huber"
) -> Selection:
    """Select the candidate with the fewest parameters among those of the least expected error, see `expected_errors`.

    Differences of the expected squared error that views by chance cause, sqrt(2 / (V - 1)), do not count. Models that
    are not injective just beyond the corners are left out: there, their extrapolation is wrong in a way that held-out
    corners do not show.
    """
    validated = [c for c in candidates if c.held_out_rms is not None]
    if not validated:
        best = min(candidates, key=lambda c: (round(c.rms, 3), c.parameters))
        reason = f"lowest rms ({best.rms:.3f} px); too few images for a cross-validation"
        return Selection(best, (best, *_ranked(candidates, best)), reason)
    injective = [c for c in validated if not _folds_near_corners(c, observations, inliers)] or validated
    weighted = with_probabilities(injective, observations, inliers)
    possible = not_rejected(weighted)
    errors = expected_errors(possible, observations, loss=loss)
    limit = errors.min() * np.sqrt(1 + np.sqrt(2 / (len(observations) - 1)))
    best, error = min(
        ((c, e) for c, e in zip(possible, errors, strict=True) if e <= limit), key=lambda ce: (ce[0].parameters, ce[1])
    )
    reason = f"expected error {error:.2g} px"
    if len(possible) > 1:
        names = ", ".join(f"{c.name} {c.probability:.0%}" for c in sorted(possible, key=_probability, reverse=True))
        reason += f" (possible models: {names})"
    if (excluded := min(validated, key=_held_out)) not in injective:
        reason += f" ({excluded.name} is not injective beyond the corners)"
    rest = [c for c in candidates if all(c.name != w.name for w in weighted)]
    return Selection(best, (best, *_ranked([*weighted, *rest], best)), reason)


def is_better(
    one: Candidate,
    other: Candidate,
    observations: Observations,
    inliers: Bools,
    significance: float = SELECTION_SIGNIFICANCE,
) -> bool:
    """Return whether a candidate has a lower held-out error than another, relevantly and significantly.

    Relevantly: by more than `MIN_RELATIVE_GAIN`. Significantly: by chance, it would be with less than this probability,
    see `gain_p_value`.
    """
    first, second = _comparable_squares(one, other, inliers)
    is_relevant = bool(first.sum() < (1 - MIN_RELATIVE_GAIN) ** 2 * second.sum())
    return is_relevant and gain_p_value(one, other, observations, inliers) < significance


def gain_p_value(one: Candidate, other: Candidate, observations: Observations, inliers: Bools) -> float:
    """Return the probability that chance lowers the held-out error from one candidate to the other as much or more.

    This is the one-sided signed-rank test (Wilcoxon, Individual comparisons by ranking methods, Biometrics Bulletin 1,
    1945) of the differences of the squared errors of each view. A view is one sample, because its corners have common
    errors; ranks keep a view with large errors from deciding alone. Only corners inside the domain of both cameras
    count.
    """
    first, second = _comparable_squares(one, other, inliers)
    gain = np.bincount(observations.view_of_row, second - first, len(observations))
    ranks = np.empty(len(gain), np.intp)
    ranks[np.argsort(np.abs(gain))] = np.arange(1, len(gain) + 1)
    distribution = np.ones(1)  # of the sum of the ranks of positive differences, if each sign is a coin toss
    for rank in range(1, len(gain) + 1):
        distribution = np.pad(distribution, (0, rank)) / 2 + np.pad(distribution, (rank, 0)) / 2
    return float(min(distribution[ranks[gain > 0].sum() :].sum(), 1.0))


def _comparable_squares(one: Candidate, other: Candidate, inliers: Bools) -> tuple[Array, Array]:
    """Return the squared held-out errors (N,) of two candidates; zero for corners that do not count."""
    assert one.held_out_lengths is not None
    assert other.held_out_lengths is not None
    first, second = one.held_out_lengths, other.held_out_lengths
    use = inliers & (first < MIN_OUTSIDE_COST_PX) & (second < MIN_OUTSIDE_COST_PX)
    return np.where(use, first**2, 0.0), np.where(use, second**2, 0.0)


def _ranked(candidates: Sequence[Candidate], best: Candidate) -> list[Candidate]:
    """Return the other candidates: the cross-validated by held-out error, then the rest by rms."""
    others = (c for c in candidates if c is not best)
    return sorted(others, key=lambda c: (c.held_out_rms is None, c.held_out_rms or c.rms))


def _held_out(candidate: Candidate) -> float:
    return candidate.held_out_rms or 0.0


def _probability(candidate: Candidate) -> float:
    return candidate.probability or 0.0


def _folds_near_corners(candidate: Candidate, observations: Observations, inliers: Bools) -> bool:
    angles = angle_from_axis(candidate.state.points(observations)[0])[inliers]
    return candidate.state.model.theta_max < min(MIN_DOMAIN_MARGIN * float(angles.max(initial=0.0)), np.pi)


def _check_parameter_names(names: Sequence[str], models: Sequence[object]) -> None:
    known = list(dict.fromkeys(name for model in models for name in getattr(model, "param_names")))  # noqa: B009
    if unknown := sorted(set(names) - set(known)):
        closest = did_you_mean(unknown[0], known)
        raise ValueError(
            f"no candidate model has a parameter {', '.join(unknown)}{closest}; there are: {', '.join(known)}"
        )
