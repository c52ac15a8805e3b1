"""Split-half test: whether cameras calibrated on two halves of the views agree within their uncertainties."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.candidate import Candidate
from omnisight.calibration.covariance import noise_covariance
from omnisight.calibration.estimation_options import Loss
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.rotation_alignment import rotation_aligned_difference
from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.geometry.sphere import cap
from omnisight.models import Projector
from omnisight.quality.uncertainty import Uncertainty
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# Views below which half of them do not determine a camera reliably.
MIN_VIEWS = 8
# Rings of directions in which the two cameras are compared.
RINGS = 12


@dataclass(frozen=True)
class SplitHalfTest(Displayed):
    """The difference between two cameras, each calibrated on every other view.

    Their covariances predict the difference that corner noise causes. A much larger one has another cause: a model
    that does not fit the lens, a board that is not flat or not to scale, a camera that changed. mrcal calls this
    cross-validation.

    Attributes
    ----------
    difference
        Root mean square difference over the calibrated cone after the best rotation, px.
    predicted
        The same according to their covariances.
    """

    difference: float
    predicted: float

    @property
    def ratio(self) -> float:
        """Difference relative to the predicted one."""
        return self.difference / max(self.predicted, 1e-12)

    def as_dict(self) -> dict[str, float]:
        """Return the figures by name, px."""
        return {"difference": self.difference, "predicted": self.predicted}


def run_split_half_test(
    candidate: Candidate, observations: Observations, as_camera: Callable[[Projector, Array], Camera], *, loss: Loss
) -> SplitHalfTest | None:
    """Calibrate on the even and on the odd views and compare the cameras; None with fewer than `MIN_VIEWS` views.

    Parameters
    ----------
    candidate
        The model fitted to all views.
    observations
        All views.
    as_camera
        (model, covariance) -> camera.
    loss
        As in `refine`.
    """
    if len(observations) < MIN_VIEWS:
        return None
    weights = ResidualWeights.estimate(candidate.state, observations, loss)
    halves = [np.arange(first, len(observations), 2) for first in (0, 1)]
    cameras: list[Camera] = []
    for views, state in zip(halves, candidate.leave_out(halves[::-1], observations, weights), strict=True):
        covariance = noise_covariance(replace(candidate, state=state), observations.subset(views), loss=loss)
        cameras.append(as_camera(state.model, covariance))
    first, second = cameras
    uncertainties = [Uncertainty.of(camera) for camera in cameras]
    bearings = cap(uncertainties[0].reach, RINGS)
    pixels, valid = first.model.project_numpy(bearings)
    visible = valid & first.in_image(pixels) & first.calibrated(bearings)
    bearings, pixels = bearings[visible], pixels[visible]
    predicted = np.sum([np.trace(u.projection(bearings), axis1=1, axis2=2) for u in uncertainties], axis=0)
    difference = np.linalg.norm(rotation_aligned_difference(second.model, bearings, pixels), axis=1)
    known = np.isfinite(difference) & np.isfinite(predicted)
    if not known.any():
        return None
    return SplitHalfTest(float(np.sqrt((difference[known] ** 2).mean())), float(np.sqrt(predicted[known].mean())))
