"""Prior of the experimental design: the Fisher information of the images taken so far."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.bundle_adjustment import Bundle
from omnisight.calibration.candidate import Candidate
from omnisight.calibration.covariance import camera_covariance, residual_variance, variance_inflation
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.resection import resect
from omnisight.calibration.residual_weights import MIN_SIGMA_PX, ResidualWeights
from omnisight.calibration.state import State
from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.geometry.sphere import angle_from_axis
from omnisight.quality.checks.residuals import MAX_MEDIAN_PX
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# Lower bound of the eigenvalues of the information matrix scaled to a unit diagonal: unobservable combinations of
# parameters get a large finite variance, and the information of one more image stands above rounding.
MIN_EIGENVALUE = 1e-11


@dataclass(frozen=True)
class InformationPrior(Displayed):
    """A camera refined on images, with the information that these images provide.

    Attributes
    ----------
    camera
        The refined camera; its `theta_max` is the largest angle off-axis of a corner.
    state
        Board poses and board warp.
    observations
        The corners.
    free_parameters
        Estimated combinations of camera parameters, without those at a bound.
    information
        (F, F) Fisher information of the shared parameters, the poses eliminated.
    noise_variance
        Variance of a corner coordinate, px^2, including the variance_inflation between images.
    basis
        (S, F) shared parameters (camera first, then board warp) per unit of the F coordinates of `information`.
    """

    camera: Camera
    state: State
    observations: Observations
    free_parameters: FreeParameters
    information: Array
    noise_variance: float
    basis: Array

    @classmethod
    def estimate(cls, camera: Camera, observations: Observations) -> Self:
        """Refine a camera on images and compute their information.

        Parameters
        ----------
        camera
            Initial camera; the parameters that its calibration estimated are estimated again.
        observations
            The corners.

        Raises
        ------
        ValueError
            If there are no corners, or the camera does not fit them.
        """
        if not len(observations):
            raise ValueError("no image shows the board: at least one is needed to propose the next")
        free = estimated_parameters(camera)
        initial = resect(camera.model, observations)
        fit = Candidate.fit(camera.model.name, initial, observations, free, loss="huber")
        state = fit.state
        median = float(np.median(state.lengths(observations)))
        if not median <= MAX_MEDIAN_PX * camera.px_unit:
            raise ValueError(
                f"the camera does not fit these images: the median residual is {median:.1f} px. Check that it is the"
                " camera that took them, or calibrate them first"
            )
        weights = ResidualWeights.estimate(state, observations)
        is_inlier = np.isfinite(state.residuals(observations)).all(1) & ~weights.outliers(state, observations)
        theta_max = float(angle_from_axis(state.points(observations)[0])[is_inlier].max(initial=0.0))
        covariance = camera_covariance(fit, observations)
        camera = replace(camera, model=state.model, theta_max=theta_max, covariance=covariance)
        normal = Bundle(observations, free, weights).linearize(state)
        is_used = np.diagonal(normal.shared) > 0
        variance = max(residual_variance(weights, observations, free), MIN_SIGMA_PX**2)
        variance *= variance_inflation(fit, observations)
        information = normal.reduced()[0][np.ix_(is_used, is_used)] / variance
        free = replace(free, directions=free.directions[:, is_used[: free.directions.shape[1]]])
        return cls(camera, state, observations, free, information, variance, np.eye(len(information)))

    @property
    def theta_max(self) -> float:
        """Largest angle off-axis (radians) of a corner."""
        return self.camera.theta_max or 0.0

    @property
    def camera_basis(self) -> Array:
        """(P, F) camera parameters per unit of the coordinates of `information`."""
        directions = self.free_parameters.directions
        return directions @ self.basis[: directions.shape[1]]

    @cached_property
    def covariance_root(self) -> Array:
        """L (F, F) with L L^T the inverse of the information; unobservable directions get a large variance."""
        scale = 1 / np.sqrt(np.maximum(np.diagonal(self.information), 1e-300))
        values, vectors = np.linalg.eigh(scale[:, None] * self.information * scale)
        return scale[:, None] * vectors / np.sqrt(np.maximum(values, MIN_EIGENVALUE))


def estimated_parameters(camera: Camera) -> FreeParameters:
    """Return the parameters that the calibration of a camera estimated, from its covariance and board warp."""
    model, covariance = camera.model, camera.covariance
    warp = "board_warp" in camera.calibration
    names = model.param_names
    if covariance is None or covariance.shape != (len(names), len(names)) or not np.diagonal(covariance).any():
        return FreeParameters.of(model, warp=warp)
    free = {name for name, variance in zip(names, np.diagonal(covariance), strict=True) if variance > 0}
    square = False
    if {"fx", "fy"} <= free:
        i, j = names.index("fx"), names.index("fy")
        square = bool(np.allclose(covariance[i], covariance[j], rtol=1e-9, atol=0))
    fixed = [name for name in names if name not in free]
    return FreeParameters.of(model, fixed=fixed, free=[*free], square=square, warp=warp)
