"""Model averaging: the probability of each camera model, and what the doubt between them adds to the covariance.

Models that predict held-out corners equally well can differ by pixels elsewhere, where the poses of the boards absorb
the difference. The covariance of one model assumes that it is exact; the mixture of all models that the images do not
reject includes their disagreement (Hoeting et al., Bayesian model averaging: a tutorial, Statistical Science 14, 1999).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.candidate import Candidate
from omnisight.calibration.covariance import noise_covariance, variance_inflation
from omnisight.calibration.estimation_options import Loss
from omnisight.calibration.residual_weights import MIN_SIGMA_PX, OUTLIER_SIGMA
from omnisight.calibration.rotation_alignment import rotation_aligned_difference
from omnisight.geometry import rotation as so3
from omnisight.optim.loss import Huber
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

# Resampled sets of views that determine the probabilities.
BOOTSTRAP_SAMPLES = 1000
# Probability below which a model is rejected: its share of the variance would be negligible.
MIN_PROBABILITY = 0.01
# Corners at which cameras are compared.
COMPARED_CORNERS = 500


def with_probabilities(candidates: Sequence[Candidate], observations: Observations, inliers: Bools) -> list[Candidate]:
    """Return cross-validated candidates with the probability that each predicts further views best.

    These are the weights of pseudo-Bayesian model averaging with the Bayesian bootstrap: the log likelihoods of the
    held-out views, summed with random weights of the views, are converted to probabilities and averaged (Yao, Vehtari,
    Simpson and Gelman, Using stacking to average Bayesian predictive distributions, Bayesian Analysis 13, 2018, sec.
    3.4). A view is one sample, so errors that all corners of a view share do not count as evidence many times.
    """
    views, sigma = len(observations), min(c.held_out_rms or 0.0 for c in candidates) / np.sqrt(2)  # of a coordinate
    sigma = max(sigma, MIN_SIGMA_PX)
    loss = Huber(OUTLIER_SIGMA * sigma)
    costs = [loss.costs(np.where(inliers, _held_out_lengths(c), 0.0)) for c in candidates]
    log_likelihood = -np.array([np.bincount(observations.view_of_row, cost, views) for cost in costs]) / sigma**2
    share = np.random.default_rng(0).dirichlet(np.ones(views), BOOTSTRAP_SAMPLES)
    total = views * share @ log_likelihood.T
    likelihood = np.exp(total - total.max(1, keepdims=True))
    probabilities = (likelihood / likelihood.sum(1, keepdims=True)).mean(0)
    return [replace(c, probability=float(p)) for c, p in zip(candidates, probabilities, strict=True)]


def not_rejected(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return the candidates that the images do not reject."""
    return [c for c in candidates if (c.probability or 0.0) >= MIN_PROBABILITY]


def expected_errors(candidates: Sequence[Candidate], observations: Observations, *, loss: Loss = "huber") -> Array:
    """Return the expected root mean square error (K,), px, of each camera after the best rotation of its frame.

    If model j is true with probability P_j, the expected squared error of camera i is sum_j P_j (|p_i - p_j|^2 + tr
    cov p_j).
    """
    rows = observations.thinned_rows(COMPARED_CORNERS)
    probabilities = np.array([c.probability or 0.0 for c in candidates])
    within = np.array([_pixel_variance(c, observations, rows, loss) for c in candidates])
    between = np.zeros((len(candidates), len(candidates)))
    for i, one in enumerate(candidates):
        points = one.state.points(observations)[0][rows]
        pixels, _ = one.state.model.project_numpy(points)
        for j, other in enumerate(candidates):
            if j != i:
                squares = (rotation_aligned_difference(other.state.model, points, pixels) ** 2).sum(1)
                between[i, j] = np.nanmean(squares)
    return np.sqrt((between + within) @ probabilities / probabilities.sum())


def _pixel_variance(candidate: Candidate, observations: Observations, rows: NDArray[np.intp], loss: Loss) -> float:
    """Return the mean variance (px^2) of a pixel due to corner noise, the best rotation of the frame removed.

    It is infinite if the model projects none of the points.
    """
    points = candidate.state.points(observations)[0][rows]
    _, _, d_point, d_params = candidate.state.model.project_with_jacobians(points)
    d_rotation = -d_point @ so3.hat(points)
    known = np.isfinite(d_params).all((1, 2)) & np.isfinite(d_rotation).all((1, 2))
    if not known.any():
        return np.inf
    jacobian = d_params[known].reshape(-1, d_params.shape[-1])
    basis = np.linalg.qr(d_rotation[known].reshape(-1, 3))[0]
    jacobian = jacobian - basis @ (basis.T @ jacobian)
    covariance = noise_covariance(candidate, observations, loss=loss)
    return float(np.einsum("ij,jk,ik->", jacobian, covariance, jacobian) / known.sum())


def averaged_covariance(
    best: Candidate, candidates: Sequence[Candidate], observations: Observations, *, loss: Loss = "huber"
) -> Array:
    """Return the covariance (P, P) of the parameters of a central camera under all models that are not rejected.

    Model j predicts the pixels p_j(b) and has derivatives J_j by its parameters, with covariance C_j. With J and J_r
    the derivatives of the selected camera by its parameters and by a rotation of its frame, [A_j, .] = [J, J_r]^+ J_j
    expresses a change of the parameters of j by one of those of the selected camera, and [d_j, .] = [J, J_r]^+ (p_j -
    p) is the difference of the two. The mixture has the covariance sum_j P_j (A_j C_j A_j^T + d_j d_j^T) about the
    selected camera.

    The probabilities rest on V views. If a model was selected by them, the errors follow Student's t distribution with
    n = V - 1 degrees of freedom, which to first order has the variance 1 + 2/n.

    Parameters
    ----------
    best
        The selected candidate.
    candidates
        All candidates with their probabilities; the selected one is among them, perhaps fitted to fewer corners.
    observations
        All views.
    loss
        As in `refine`.
    """
    own = noise_covariance(best, observations, loss=loss)
    others = [c for c in not_rejected(candidates) if c.name != best.name]
    factor = 1 + 2 / max(len(observations) - 1, 1) if len(candidates) > 1 else 1.0
    if not others:
        return factor * variance_inflation(best, observations) * own
    points = best.state.points(observations)[0][observations.thinned_rows(COMPARED_CORNERS)]
    pixels, _, d_point, d_params = best.state.model.project_with_jacobians(points)
    free = best.free_parameters.directions
    derivatives = np.concatenate([d_params @ free, -d_point @ so3.hat(points)], -1)
    total, between = best.probability or 0.0, np.zeros_like(own)
    within = total * own
    for other in others:
        assert other.probability is not None
        projected, _, _, other_d_params = other.state.model.project_with_jacobians(points)
        known = np.isfinite(derivatives).all((1, 2)) & np.isfinite(other_d_params).all((1, 2))
        wanted = np.concatenate([other_d_params, (projected - pixels)[..., None]], -1)[known]
        solution = np.linalg.lstsq(
            derivatives[known].reshape(-1, derivatives.shape[-1]), wanted.reshape(-1, wanted.shape[-1]), rcond=None
        )[0]
        change = free @ solution[: free.shape[1]]
        mapping, difference = change[:, :-1], change[:, -1]
        within += other.probability * mapping @ noise_covariance(other, observations, loss=loss) @ mapping.T
        between += other.probability * np.outer(difference, difference)
        total += other.probability
    return factor * (variance_inflation(best, observations) * within + between) / total


def _held_out_lengths(candidate: Candidate) -> Array:
    assert candidate.held_out_lengths is not None
    return candidate.held_out_lengths
