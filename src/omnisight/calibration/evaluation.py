"""Evaluation of a calibrated camera on images it was not calibrated on: only board poses and warp are estimated."""

from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.candidate import Candidate
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.model_selection import MIN_VIEWS
from omnisight.calibration.pose_covariance import pose_covariances
from omnisight.calibration.prescription import resect_prescription
from omnisight.calibration.resection import resect
from omnisight.calibration.residual_weights import OUTLIER_SIGMA, ResidualWeights
from omnisight.calibration.state import State, identity_whitening
from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.geometry.sphere import angle_from_axis
from omnisight.optim.loss import robust_sigma
from omnisight.ray_camera import RayCamera
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

# Huber threshold, px: that of BabelCalib.
HUBER_THRESHOLD_PX = 1.5
# Margin (radians) of the calibrated cone.
CONE_MARGIN_RAD = np.radians(0.5)
# Width of a ring of angles, and of one if the corners reach less than `NARROW_DEG`.
RING_DEG, NARROW_RING_DEG, NARROW_DEG = 10.0, 5.0, 45.0


@dataclass(frozen=True)
class ResidualStatistics:
    """Statistics of residual lengths, px.

    Attributes
    ----------
    corners
        Number of corners.
    rms, mean, median, worst
        Root mean square, mean, median and maximum of their residual lengths; NaN without corners.
    wrms
        Root mean square of the weighted lengths; the weight is 1 up to a threshold T and sqrt(T / length) beyond, the
        Huber weight of BabelCalib (Lochman et al., ICCV 2021, and `huberWeightIRLS` of its code).
    """

    corners: int
    rms: float
    mean: float
    median: float
    wrms: float
    worst: float

    @classmethod
    def of(cls, lengths: Array, threshold: float = HUBER_THRESHOLD_PX) -> "ResidualStatistics":
        """Return the statistics of lengths (N,)."""
        if not len(lengths):
            return cls(0, *(float("nan"),) * 5)
        weighted = lengths * np.minimum(lengths, threshold)
        rms, wrms = float(np.sqrt((lengths**2).mean())), float(np.sqrt(weighted.mean()))
        return cls(len(lengths), rms, float(lengths.mean()), float(np.median(lengths)), wrms, float(lengths.max()))

    def as_dict(self) -> dict[str, float | int | None]:
        """Return the values by name; None if undefined."""
        return {name: value if np.isfinite(value) else None for name, value in asdict(self).items()}


@dataclass(frozen=True)
class Ring:
    """Residuals of the corners between two angles from the axis (radians)."""

    start: float
    stop: float
    statistics: ResidualStatistics


@dataclass(frozen=True)
class Evaluation(Displayed):
    """Residuals of a camera on images it was not calibrated on.

    Attributes
    ----------
    camera
        The camera, unchanged.
    state
        Its model, cam_from_board of every view, and the board warp.
    observations
        The corners.
    threshold
        Huber threshold, px, of the poses and of `ResidualStatistics.wrms`.
    """

    camera: Camera | RayCamera
    state: State
    observations: Observations
    threshold: float = HUBER_THRESHOLD_PX

    @cached_property
    def residuals(self) -> Array:
        """(N, 2) projected minus observed pixels; NaN outside the model's domain."""
        return self.state.residuals(self.observations)

    @cached_property
    def lengths(self) -> Array:
        """(N,) residual length of each corner, px; NaN outside the model's domain."""
        return np.linalg.norm(self.residuals, axis=1)

    @cached_property
    def theta(self) -> Array:
        """(N,) angle of each corner from the axis, radians."""
        return angle_from_axis(self.state.points(self.observations)[0])

    @cached_property
    def in_domain(self) -> Bools:
        """(N,) which corners are inside the model's domain."""
        return np.isfinite(self.lengths)

    @cached_property
    def calibrated(self) -> Bools:
        """(N,) which corners lie in the calibrated cone; all if it is unknown."""
        farthest = np.pi if self.camera.theta_max is None else self.camera.theta_max + CONE_MARGIN_RAD
        return (self.theta >= self.camera.theta_min - CONE_MARGIN_RAD) & (self.theta <= farthest)

    @cached_property
    def outliers(self) -> Bools:
        """(N,) which corners are outliers or outside the model's domain."""
        return ~(self.lengths <= OUTLIER_SIGMA * robust_sigma(self.lengths[self.in_domain]))

    @cached_property
    def pose_covariances(self) -> Array:
        """(V, 6, 6) covariance of `state.cam_from_board`, see `pose_covariance`; a camera without one counts as exact.

        Steps (w, v) of `Pose.moved`: rotation vector in radians and translation in the unit of the board.
        """
        model, warp = self.state.model, bool(self.state.warp.any())
        fitted = Candidate.from_state(model.name, self.state, self.observations, FreeParameters.of(model, warp=warp))
        exact = np.zeros((len(model.params),) * 2)
        return pose_covariances(
            fitted, self.observations, exact if self.camera.covariance is None else self.camera.covariance
        )

    def statistics(self, which: Bools | None = None) -> ResidualStatistics:
        """Return the statistics of all corners in the domain, or of some of them (N,)."""
        use = self.in_domain if which is None else self.in_domain & which
        return ResidualStatistics.of(self.lengths[use], self.threshold)

    def rings(self) -> list[Ring]:
        """Return the statistics by angle from the axis, without empty rings."""
        reach = float(np.degrees(self.theta[self.in_domain].max(initial=0.0)))
        width = NARROW_RING_DEG if reach < NARROW_DEG else RING_DEG
        edges = np.radians(np.arange(0.0, reach + width, width))
        index = np.digitize(self.theta, edges[1:])
        rings = [
            Ring(start, stop, self.statistics(index == k)) for k, (start, stop) in enumerate(pairwise(edges.tolist()))
        ]
        return [ring for ring in rings if ring.statistics.corners]


def evaluate_camera(
    camera: Camera | RayCamera,
    observations: Observations,
    *,
    threshold: float = HUBER_THRESHOLD_PX,
    flat: bool = False,
) -> Evaluation:
    """Evaluate a camera on corners it was not calibrated on; only board poses and board warp are estimated.

    With `flat` this is the protocol of BabelCalib (Lochman et al., ICCV 2021): the poses minimize the Huber cost with a
    fixed threshold in px. (Its code minimizes the squares of the weighted residuals, whose minimum is close to it.)

    Parameters
    ----------
    camera
        The camera.
    observations
        The corners.
    threshold
        Huber threshold, px.
    flat
        Whether the board is flat. Otherwise one warp for all views is estimated with the poses, from three views on.

    Raises
    ------
    ValueError
        If there are no corners, the threshold is not positive, or a non-central camera sees too few of the corners.
    """
    if not len(observations.pixels):
        raise ValueError("there are no corners to evaluate the camera on")
    if not threshold > 0:
        raise ValueError(f"threshold must be a positive length in px, got {threshold:g}")
    warp = not flat and observations.is_planar and len(observations) >= MIN_VIEWS
    free_parameters = FreeParameters(np.zeros((len(camera.model.param_names), 0)), warp)
    weights = ResidualWeights(identity_whitening(len(observations.pixels)), 1.0, threshold)
    is_central = isinstance(camera, Camera)
    start = resect(camera.model, observations) if is_central else resect_prescription(camera.model, observations)
    solution = refine(start, observations, free_parameters=free_parameters, weights=weights)
    return Evaluation(camera, solution.state, observations, threshold)
