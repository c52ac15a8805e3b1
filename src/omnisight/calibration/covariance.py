"""How well the corners tell a camera's parameters."""

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.bundle_adjustment import Bundle
from omnisight.calibration.candidate import Candidate
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import State
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# What an image tells to more than this part has no other image to be compared with.
ALONE = 0.9
# Standard deviations that chance may reach.
CHANCE = 2.0


def camera_covariance(candidate: Candidate, views: Observations, *, loss: str = "huber") -> Array:
    """Give the covariance (P, P) of the camera's parameters; zero for those that stood still.

    That of corner noise, times what images disagree by more than that: corners of one image are not off
    independently of each other. A board that bends in the hand, focus that moved, blur and a detector's bias shift many
    of them together, and corner noise alone then promises several times too much.
    """
    return disagreement(candidate, views) * noise_covariance(candidate, views, loss=loss)


def disagreement(candidate: Candidate, views: Observations) -> float:
    """Give how many times more than corner noise has it the variance of what is estimated is; 1 if by chance.

    How much `scatter` differs from 1 by chance among so many images is taken off it, the more the nearer it is.
    """
    above, chance = scatter(candidate, views) - 1.0, CHANCE * np.sqrt(2 / max(len(views) - 1, 1))
    return 1.0 + max(above - chance**2 / above, 0.0) if above > 0 else 1.0


def scatter(candidate: Candidate, views: Observations) -> float:
    """Give the variance of what is estimated as images disagree, over what corner noise makes it.

    Each image counts as one draw, whatever is wrong within it. With H the normal equations, poses eliminated, and H_k
    and g_k an image's part of them and of the gradient, the covariance would be

        H^-1 (sum_k A_k g_k g_k^T A_k^T) H^-1,    A_k = L (I - L^-1 H_k L^-T)^(-1/2) L^-1,    H = L L^T

    where A_k makes up for what the camera was bent to suit the image itself (Bell and McCaffrey, Bias reduction in
    standard errors for linear regression with multi-stage samples, Survey Methodology 28, 2002). From 20 images it is
    too uncertain itself to be taken as it is; its mean over all that is estimated tells how much too small H^-1 is.
    What one image tells alone is as uncertain as corner noise has it, and a prior as uncertain as it says.
    """
    state, freedom = candidate.state, candidate.freedom
    spread = ResidualWeights.of(state, views)
    variance = residual_variance(spread, views, freedom)
    problem = Bundle(views, freedom, spread)
    root = problem.linearize(state).half_covariance()
    count = root.shape[1]
    if not count or not variance > 0:
        return 1.0
    compared, among = 0.0, 0.0
    for part, gradient in zip(*_by_picture(problem, state), strict=True):
        share, turn = np.linalg.eigh(root.T @ part @ root)
        known = np.where(share > ALONE, 0.0, np.maximum(share, 0.0))
        off = np.where(known > 0, turn.T @ (root.T @ gradient), 0.0)
        compared += float(known.sum())
        among += float((off**2 / (1 - known)).sum())
    rest = max(count - compared, 0.0)
    return (among / variance + rest) / count


def noise_covariance(candidate: Candidate, views: Observations, *, loss: str = "huber") -> Array:
    """Give the same as corner noise alone has it: what would be if nothing were wrong that corners share.

    The inverse of the normal equations, the poses and the bend of the board eliminated: whatever they take up is
    uncertain in the camera. Residuals have the spread that they show, each pose and parameter having taken its part of
    it (Triggs et al. 2000, sec. 9).
    """
    state, freedom = candidate.state, candidate.freedom
    spread = ResidualWeights.of(state, views, loss)
    normal = Bundle(views, freedom, spread).linearize(state)
    count = freedom.directions.shape[1]
    among = normal.shared_covariance()[:count, :count]
    return residual_variance(spread, views, freedom) * freedom.directions @ among @ freedom.directions.T


def residual_variance(spread: ResidualWeights, views: Observations, freedom: FreeParameters) -> float:
    """Give the variance, px^2, of a corner's coordinate: that of the residuals, and what was fitted of it."""
    measured = views.pixels.size
    left = measured - freedom.count - 6 * len(views)
    return spread.sigma**2 * measured / max(left, 1)


def _by_picture(problem: Bundle, state: State) -> tuple[Array, Array]:
    """Give each image's part of the normal equations (V, F, F) and of the gradient (V, F), its pose eliminated."""
    residuals, jacobian, cross, local, local_gradient = problem.rows(state)
    jacobian, cross = jacobian @ problem.directions, problem.directions.T @ cross
    pose = np.linalg.pinv(local, rcond=1e-14, hermitian=True)
    gain = cross @ pose
    parts, gradients = list[Array](), list[Array]()
    for k, rows in enumerate(problem.views.groups):
        j = jacobian[2 * rows.start : 2 * rows.stop]
        parts.append(j.T @ j - gain[k] @ cross[k].T)
        gradients.append(j.T @ residuals[2 * rows.start : 2 * rows.stop] - gain[k] @ local_gradient[k])
    return np.array(parts), np.array(gradients)
