"""Whether two halves of the images agree as well as a calibration says they should."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.candidate import Candidate
from omnisight.calibration.covariance import noise_covariance
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.camera import Camera
from omnisight.geometry.sphere import cap
from omnisight.models import CameraModel
from omnisight.quality.aligned_difference import rotation_aligned_difference
from omnisight.quality.uncertainty import Uncertainty
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

FEWEST = 8
RINGS = 12


@dataclass(frozen=True)
class SplitHalfTest:
    """Two cameras, calibrated on every other image each.

    What corner noise makes them differ by is predicted by their covariances; where they differ by much more, something
    else is at work: a model too poor for the lens, a board that is not what it should be, a camera that changed.
    mrcal compares calibrations so ("cross-validation").

    Attributes
    ----------
    difference
        Root mean square over the calibrated cone of what the two differ by, px, one turned to fit the other.
    predicted
        The same as their covariances have it.
    """

    difference: float
    predicted: float

    @property
    def ratio(self) -> float:
        """How many times larger the difference is than predicted."""
        return self.difference / max(self.predicted, 1e-12)

    def as_dict(self) -> dict[str, float]:
        """Give the figures by name, px."""
        return {"difference": self.difference, "predicted": self.predicted}


def run_split_half_test(
    candidate: Candidate, views: Observations, as_camera: Callable[[CameraModel, Array], Camera], *, loss: str
) -> SplitHalfTest | None:
    """Calibrate on the even and on the odd views and compare; None with fewer than eight.

    `as_camera` makes a camera of a model that was fitted and its covariance.
    """
    if len(views) < FEWEST:
        return None
    spread = ResidualWeights.of(candidate.state, views, loss)
    cameras: list[Camera] = []
    halves = [np.arange(first, len(views), 2) for first in (0, 1)]
    for some, state in zip(halves, candidate.without(halves[::-1], views, spread), strict=True):
        half = replace(candidate, state=state)
        covariance = noise_covariance(half, views.subset(some), loss=loss)
        cameras.append(as_camera(state.model, covariance))
    one, other = cameras
    uncertainties = [Uncertainty.of(c) for c in cameras]
    bearings = cap(uncertainties[0].reach, RINGS)
    pixels, valid = one.model.project_numpy(bearings)
    seen = valid & one.in_image(pixels) & one.calibrated(bearings)
    bearings, pixels = bearings[seen], pixels[seen]
    spreads = [np.trace(u.projection(bearings), axis1=1, axis2=2) for u in uncertainties]
    predicted = spreads[0] + spreads[1]
    difference = np.linalg.norm(rotation_aligned_difference(other.model, bearings, pixels), axis=1)
    known = np.isfinite(difference) & np.isfinite(predicted)
    if not known.any():
        return None
    return SplitHalfTest(
        float(np.sqrt((difference[known] ** 2).mean())),
        float(np.sqrt(predicted[known].mean())),
    )
