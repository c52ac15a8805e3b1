"""Estimation of a bend of the board in each view, as a printed sheet without a backing has."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.bundle_adjustment import Bundle, refine
from omnisight.calibration.candidate import Candidate
from omnisight.calibration.covariance import residual_variance
from omnisight.calibration.estimation_options import Loss
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.optim.tolerances import COMPARISON_TOLERANCE
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# Standard deviation of the bends relative to half of the board, from which its estimation starts.
START_SIGMA = 0.05
# Steps of the estimation of that standard deviation.
SIGMA_STEPS = 4


def with_board_bends(candidate: Candidate, observations: Observations, sigma: float, *, loss: Loss) -> Candidate:
    """Return the candidate refitted with a bend of the board in each view; `sigma` is that of their prior."""
    free_parameters = replace(candidate.free_parameters, bend_sigma=sigma)
    fitted = Candidate.fit(
        candidate.name, candidate.state, observations, free_parameters, loss=loss, tolerance=COMPARISON_TOLERANCE
    )
    return replace(fitted, probability=candidate.probability)


def estimate_board_bends(candidate: Candidate, observations: Observations, *, loss: Loss) -> Candidate:
    """Return the candidate refitted with bends whose prior is estimated too.

    The standard deviation of the prior maximizes the likelihood of the corners (empirical Bayes): it is the root mean
    square of the bends and of their own uncertainty, in turn with the bends (Dempster, Laird and Rubin, Maximum
    likelihood from incomplete data via the EM algorithm, Journal of the Royal Statistical Society B 39, 1977).
    """
    sigma = START_SIGMA * observations.sheet_size
    for _ in range(SIGMA_STEPS):
        candidate = with_board_bends(candidate, observations, sigma, loss=loss)
        weights = ResidualWeights.estimate(candidate.state, observations, loss)
        *_, local, _ = Bundle(observations, candidate.free_parameters, weights).blocks(candidate.state)
        variance = residual_variance(weights, observations, candidate.free_parameters)
        own = variance * np.linalg.inv(local)[:, range(6, 9), range(6, 9)]
        sigma = float(np.sqrt((candidate.state.bends_or_zero**2 + own).mean()))
    return candidate


def with_half_held_out(candidate: Candidate, observations: Observations, *, loss: Loss) -> Candidate:
    """Return the candidate with the residuals of held-out corners: poses and bends from every other corner of a view.

    Held-out views would not do: their bends, like their poses, are estimated from the corners that are then evaluated.
    """
    weights = ResidualWeights.estimate(candidate.state, observations, loss)
    own = candidate.free_parameters.without_camera()
    lengths = np.empty(len(observations.pixels))
    for half in (0, 1):
        rows, held_out = (np.arange(k, len(lengths), 2) for k in (half, 1 - half))
        part, its_weights = observations.at(rows), weights.subset(rows)
        state = refine(candidate.state, part, free_parameters=own, weights=its_weights, tolerance=COMPARISON_TOLERANCE)
        lengths[held_out] = state.state.lengths(observations)[held_out]
    return replace(candidate, held_out_lengths=lengths)
