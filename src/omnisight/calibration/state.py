"""The unknowns of a calibration: camera model, board poses and board warp."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration._bundle_kernel import transform_points, whitened_lengths
from omnisight.display import Displayed
from omnisight.geometry.pose import Pose
from omnisight.models import CameraModel, Projector
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# Least residual length (px) assigned to a point outside the model's domain: a gross error, but a finite one.
MIN_OUTSIDE_COST_PX = 100.0


@dataclass(frozen=True)
class State(Displayed):
    """A camera model, the pose of the board in each view, and the board warp.

    Attributes
    ----------
    model
        The camera model, central or not.
    rotations, translations
        cam_from_board, (V, 3, 3) and (V, 3).
    warp
        (2,) height of the board's middle above the plane of its edges, along x and along y: z = warp_basis . warp in
        the unit of the board, positive away from the printed side (`Observations.warp_basis`).
    bends
        (V, 3) bend of the sheet in each view, its height b0 s^2 + b1 s t + b2 t^2 at (s, t) = `Observations.sheet`, in
        the unit of the board; None if it is flat up to the warp.
    """

    model: Projector
    rotations: Array
    translations: Array
    warp: Array = field(default_factory=lambda: np.zeros(2))
    bends: Array | None = None

    @property
    def central_model(self) -> CameraModel:
        """The camera model of a central camera.

        Raises
        ------
        TypeError
            If the camera is not central.
        """
        if not isinstance(self.model, CameraModel):
            raise TypeError(f"{self.model.name} is not a central camera model")
        return self.model

    def points(self, observations: Observations) -> tuple[Array, Array]:
        """Return the board points in the camera frame (N, 3), and rotated but not translated (N, 3)."""
        o = observations
        bent = o.sheet, o.sheet_size, self.bends_or_zero
        return transform_points(
            o.points, o.warp_basis, self.warp, *bent, o.view_of_row, self.rotations, self.translations
        )

    @property
    def bends_or_zero(self) -> Array:
        """(V, 3) bend of the sheet in each view."""
        return np.zeros((len(self.rotations), 3)) if self.bends is None else self.bends

    @property
    def cam_from_board(self) -> tuple[Pose, ...]:
        """Pose of the board in every view."""
        return tuple(Pose(r, t) for r, t in zip(self.rotations, self.translations, strict=True))

    def subset(self, views: NDArray[np.intp]) -> "State":
        """Return the state of some of the views."""
        bends = None if self.bends is None else self.bends[views]
        return replace(self, rotations=self.rotations[views], translations=self.translations[views], bends=bends)

    def residuals(self, observations: Observations) -> Array:
        """Return projected minus observed pixels (N, 2), NaN outside the model's domain."""
        pixels, _ = self.model.project_numpy(self.points(observations)[0])
        return pixels - observations.pixels

    def lengths(self, observations: Observations, whitening: Array | None = None) -> Array:
        """Return the length (px) of each residual (N,), multiplied by `whitening` (N, 2, 2) if given."""
        return residual_lengths(self.residuals(observations), observations, whitening)


def residual_lengths(residuals: Array, observations: Observations, whitening: Array | None = None) -> Array:
    """Return the lengths (px) of residuals (N, 2), whitened if requested; `outside_cost` for NaN."""
    matrices = identity_whitening(len(residuals)) if whitening is None else whitening
    return whitened_lengths(residuals, matrices, outside_cost(observations))


def identity_whitening(count: int) -> Array:
    """Return the whitening matrices (N, 2, 2) of equal weights."""
    return np.tile(np.eye(2), (count, 1, 1))


def outside_cost(observations: Observations) -> float:
    """Return the residual length (px) assigned to a point outside the model's domain.

    It is at least the length that an outlier can have; otherwise folding the image over to lose outliers would pay.
    """
    return max(MIN_OUTSIDE_COST_PX, observations.pixel_span)
