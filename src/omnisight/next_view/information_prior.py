"""What the images so far tell of a camera, and what one more would add."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.bundle_adjustment import Bundle
from omnisight.calibration.candidate import Candidate
from omnisight.calibration.covariance import camera_covariance, disagreement, residual_variance
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.resection import resect
from omnisight.calibration.residual_weights import MIN_SIGMA_PX, ResidualWeights
from omnisight.calibration.state import State
from omnisight.camera import Camera
from omnisight.geometry.sphere import angle_from_axis
from omnisight.quality.checks import LARGE_PX
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# What is known of a combination of parameters beforehand, as a share of what is known of each of them alone: with a few
# images some are not told at all, and what one more image tells of them must stand above rounding.
BEFORE = 1e-11


@dataclass(frozen=True)
class InformationPrior:
    """A camera refined on images, and what these tell of it.

    Attributes
    ----------
    camera
        Refined; its `theta_max` is how far from the axis corners were seen.
    state, views
        Poses and bend of the board, and the corners.
    freedom
        What was estimated; a parameter that stands at a bound is left out.
    information
        (F, F) of what all images share, the poses eliminated: the inverse of its covariance.
    variance
        Of a corner's coordinate, px^2: the spread of the residuals, and what images disagree by beside.
    basis
        (S, F) how the S numbers that all images share, camera first, move with the F things that `information` is of.
    """

    camera: Camera
    state: State
    views: Observations
    freedom: FreeParameters
    information: Array
    variance: float
    basis: Array

    @classmethod
    def of(cls, camera: Camera, views: Observations) -> Self:
        """Refine a camera on images and take its normal equations.

        Parameters
        ----------
        camera
            Where to begin; what its calibration estimated is estimated again.
        views
            The corners.

        Raises
        ------
        ValueError
            If there are no corners, or the camera is not that of the images.
        """
        if not len(views):
            raise ValueError("no image shows the board: there is nothing to go on from")
        freedom = estimated(camera)
        fit = Candidate.fit(camera.model.name, resect(camera.model, views), views, freedom, loss="huber")
        state = fit.state
        median, limit = float(np.median(state.lengths(views))), LARGE_PX * camera.px_unit
        if not median <= limit:
            raise ValueError(
                f"the camera does not explain these images: half of the corners are more than {median:.1f} px off;"
                " is it the camera that took them? Calibrate them first"
            )
        spread = ResidualWeights.of(state, views)
        outliers = spread.outliers(state, views)
        shown = np.isfinite(state.residuals(views)).all(1) & ~outliers
        reach = float(angle_from_axis(state.points(views)[0])[shown].max(initial=0.0))
        camera = replace(camera, model=state.model, theta_max=reach, covariance=camera_covariance(fit, views))
        normal = Bundle(views, freedom, spread).linearize(state)
        used = np.diagonal(normal.shared) > 0
        variance = max(residual_variance(spread, views, freedom), MIN_SIGMA_PX**2) * disagreement(fit, views)
        moving = freedom.directions[:, used[: freedom.directions.shape[1]]]
        schur = normal.reduced()[0][np.ix_(used, used)]
        freedom = replace(freedom, directions=moving)
        return cls(camera, state, views, freedom, schur / variance, variance, np.eye(len(schur)))

    @property
    def reach(self) -> float:
        """How far from the axis (radians) corners were seen."""
        return self.camera.theta_max or 0.0

    @property
    def camera_basis(self) -> Array:
        """(P, F) how all parameters of the camera move with what `information` is of."""
        directions = self.freedom.directions
        return directions @ self.basis[: directions.shape[1]]

    @cached_property
    def half(self) -> Array:
        """L (F, F) with L L^T the inverse of the information; what nothing tells apart is very uncertain."""
        scale = 1 / np.sqrt(np.maximum(np.diagonal(self.information), 1e-300))
        values, vectors = np.linalg.eigh(scale[:, None] * self.information * scale)
        return scale[:, None] * vectors / np.sqrt(np.maximum(values, BEFORE))


def estimated(camera: Camera) -> FreeParameters:
    """Give what the camera's calibration estimated, as its covariance in the file and the board's bend tell."""
    model, covariance = camera.model, camera.covariance
    warp = "board_warp" in camera.calibration
    names = model.param_names
    if covariance is None or covariance.shape != (len(names), len(names)) or not np.diagonal(covariance).any():
        return FreeParameters.of(model, warp=warp)
    moved = {name for name, variance in zip(names, np.diagonal(covariance), strict=True) if variance > 0}
    square = False
    if {"fx", "fy"} <= moved:
        i, j = names.index("fx"), names.index("fy")
        square = bool(np.allclose(covariance[i], covariance[j], rtol=1e-9, atol=0))
    still = [name for name in names if name not in moved]
    return FreeParameters.of(model, fixed=still, free=[*moved], square=square, warp=warp)
