"""Covariance of board poses estimated with a calibrated camera: corner noise and the error of the camera itself."""

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.bundle_adjustment import Bundle
from omnisight.calibration.candidate import Candidate
from omnisight.calibration.covariance import residual_variance, variance_inflation
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]


def pose_covariances(candidate: Candidate, observations: Observations, camera_covariance: Array) -> Array:
    """Return the covariances (V, 6, 6) of cam_from_board of every view, as steps (w, v) of `Pose.moved`.

    With A, B_k and C_k the normal equations of camera and warp, their coupling to pose k, and pose k itself, an error s
    of camera and warp moves the pose by -C_k^-1 B_k^T s, in addition to the noise of its own corners:

        cov p_k = sigma^2 C_k^-1 + C_k^-1 B_k^T cov(s) B_k C_k^-1

    sigma^2 is the variance of the residuals times the excess scatter between views, see `variance_inflation`. An error
    c of the camera moves the warp that is estimated with it by -S_ww^-1 S_wc c, with S the Schur complement of the
    poses (Triggs et al., Bundle adjustment: a modern synthesis, 2000, sec. 6 and 9). This holds for the images of the
    calibration as well as for others. The camera frame is that of the model: a shift of the principal point that looks
    almost like a rotation is part of the error, and common to all poses.

    Parameters
    ----------
    candidate
        Camera, poses and warp that minimize the residuals of the views, and what was estimated of them.
    observations
        All views.
    camera_covariance
        (P, P) covariance of the camera parameters; zero for an exact camera.
    """
    state, warp = candidate.state, candidate.free_parameters.warp
    weights = ResidualWeights.estimate(state, observations)
    variance = residual_variance(weights, observations, candidate.free_parameters)
    variance *= variance_inflation(candidate, observations)
    count = len(state.model.params)
    problem = Bundle(observations, candidate.free_parameters, weights)
    normal = problem.corner_normal(state).along(np.eye(count + 2)[:, : count + 2 * warp])
    schur, _, inverse, gain = normal.reduced()
    others = np.linalg.inv(schur[count:, count:])
    response = np.concatenate([np.eye(count), -others @ schur[count:, :count]])
    shared = response @ camera_covariance @ response.T
    shared[count:, count:] += variance * others
    return (variance * inverse + np.swapaxes(gain, 1, 2) @ shared @ gain)[:, :6, :6]
