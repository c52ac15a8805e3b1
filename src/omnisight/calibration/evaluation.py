"""A camera judged on images it was not calibrated on: the camera stays, every board finds its own pose."""

from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.prescription import placed
from omnisight.calibration.resection import resect
from omnisight.calibration.residual_weights import HUBER_SIGMAS, ResidualWeights
from omnisight.calibration.state import State, identity_weights
from omnisight.camera import Camera
from omnisight.geometry.sphere import angle_from_axis
from omnisight.optim.loss import robust_sigma
from omnisight.quality.checks import FEWEST
from omnisight.ray_camera import RayCamera
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

# Length of a residual, px, past which it counts less: BabelCalib's.
THRESHOLD = 1.5
TOLERANCE = 1e-10
# Corners so little past the cone that was calibrated (radians) are of it.
EDGE = np.radians(0.5)
# Degrees that a ring of angle is wide; less where corners reach less far.
RING_DEG, NARROW_RING_DEG, NARROW_DEG = 10.0, 5.0, 45.0


@dataclass(frozen=True)
class Figures:
    """Lengths of residuals in figures, px.

    Attributes
    ----------
    corners
        How many.
    rms, mean, median, worst
        Of their lengths; NaN of none.
    wrms
        Root mean square of the lengths times their weights, which are 1 up to a threshold T and sqrt(T / length) past
        it: Huber's, as BabelCalib has them (Lochman et al., ICCV 2021, and `huberWeightIRLS` of its code).
    """

    corners: int
    rms: float
    mean: float
    median: float
    wrms: float
    worst: float

    @classmethod
    def of(cls, lengths: Array, threshold: float = THRESHOLD) -> "Figures":
        """Give them for lengths (N,)."""
        if not len(lengths):
            return cls(0, *(float("nan"),) * 5)
        weighted = lengths * np.minimum(lengths, threshold)
        rms, wrms = float(np.sqrt((lengths**2).mean())), float(np.sqrt(weighted.mean()))
        return cls(len(lengths), rms, float(lengths.mean()), float(np.median(lengths)), wrms, float(lengths.max()))

    def as_dict(self) -> dict[str, float | int | None]:
        """Give them by name; None for what is not known."""
        return {name: value if np.isfinite(value) else None for name, value in asdict(self).items()}


@dataclass(frozen=True)
class Ring:
    """Corners between two angles from the axis, radians."""

    start: float
    stop: float
    figures: Figures


@dataclass(frozen=True)
class Evaluation:
    """A camera on images it was not calibrated on.

    Attributes
    ----------
    camera
        The camera; nothing of it was changed.
    state
        Its model, cam_from_board of every image, and the bend of the board.
    views
        The corners.
    threshold
        Length of a residual, px, past which it counts less, in the poses and in `Figures.wrms`.
    """

    camera: Camera | RayCamera
    state: State
    views: Observations
    threshold: float = THRESHOLD

    @cached_property
    def residuals(self) -> Array:
        """(N, 2) projected minus seen pixels; NaN where the camera shows nothing."""
        return self.state.residuals(self.views)

    @cached_property
    def lengths(self) -> Array:
        """(N,) length of each corner's residual, px; NaN where the camera shows nothing."""
        return np.linalg.norm(self.residuals, axis=1)

    @cached_property
    def theta(self) -> Array:
        """(N,) the angle of each corner from the axis, radians."""
        return angle_from_axis(self.state.points(self.views)[0])

    @cached_property
    def shown(self) -> Bools:
        """(N,) which corners the camera shows at all: its model has a pixel for them."""
        return np.isfinite(self.lengths)

    @cached_property
    def calibrated(self) -> Bools:
        """(N,) which corners lie in the cone that the camera was calibrated in; all where its file says none."""
        farthest = np.pi if self.camera.theta_max is None else self.camera.theta_max + EDGE
        return (self.theta >= self.camera.theta_min - EDGE) & (self.theta <= farthest)

    @cached_property
    def doubtful(self) -> Bools:
        """(N,) which corners lie farther off than corners do, or have no pixel."""
        return ~(self.lengths <= HUBER_SIGMAS * robust_sigma(self.lengths[self.shown]))

    def figures(self, which: Bools | None = None) -> Figures:
        """Give the figures of the corners that it shows, of all of them or of some (N,)."""
        return Figures.of(self.lengths[self.shown if which is None else self.shown & which], self.threshold)

    def rings(self) -> list[Ring]:
        """Give the figures of the corners by their angle from the axis, ring by ring; empty ones are left out."""
        reach = float(np.degrees(self.theta[self.shown].max(initial=0.0)))
        width = NARROW_RING_DEG if reach < NARROW_DEG else RING_DEG
        edges = np.radians(np.arange(0.0, reach + width, width))
        which = np.digitize(self.theta, edges[1:])
        found = [
            Ring(start, stop, self.figures(which == k)) for k, (start, stop) in enumerate(pairwise(edges.tolist()))
        ]
        return [ring for ring in found if ring.figures.corners]


def evaluate_camera(
    camera: Camera | RayCamera, views: Observations, *, threshold: float = THRESHOLD, flat: bool = False
) -> Evaluation:
    """Judge a camera on corners it was not calibrated on: only the boards move, and bend.

    With `flat` it is the protocol of BabelCalib (Lochman et al., ICCV 2021): the poses have the least Huber cost of the
    residuals, whose threshold is fixed, in px. (Its code minimises the squares of the weighted residuals, weights and
    all, whose least lies next to that of Huber's loss.)

    Parameters
    ----------
    camera
        The camera.
    views
        The corners.
    threshold
        Length of a residual, px, past which it counts less.
    flat
        Take the board as flat. Otherwise its bend is found with the poses, the same in all images, from three on.

    Raises
    ------
    ValueError
        If there is no corner, the threshold is no length, or a camera of rays shows too few of the corners.
    """
    if not len(views.pixels):
        raise ValueError("there are no corners to judge a camera on")
    if not threshold > 0:
        raise ValueError(f"threshold must be a positive length in px, got {threshold:g}")
    model = camera.model
    freedom = FreeParameters(
        np.zeros((len(model.param_names), 0)), warp=not flat and views.planar and len(views) >= FEWEST
    )
    spread = ResidualWeights(identity_weights(len(views.pixels)), 1.0, threshold)
    start = placed(camera.model, views) if isinstance(camera, RayCamera) else resect(camera.model, views)
    state = refine(start, views, freedom=freedom, spread=spread, tolerance=TOLERANCE).state
    return Evaluation(camera, state, views, threshold)
