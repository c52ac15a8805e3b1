"""The central camera that a camera of rays is to a far scene."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.calibration.state import State
from omnisight.camera import Camera
from omnisight.models import CameraModel
from omnisight.optics.catadioptric import Catadioptric
from omnisight.optics.models.axial import Axial
from omnisight.optics.ray_model import RayModel
from omnisight.optics.viewpoint import best_viewpoint
from omnisight.ray_camera import RayCamera

Array = NDArray[np.float64]

# So far away, in the unit of the rays, that it does not matter where they begin.
FAR = 1e9


@dataclass(frozen=True)
class CentralLimit(CameraModel):
    """A camera of rays as a far scene has it: where its rays begin does not matter there, only where they go.

    Its parameters are those of the rays, all of them, so that what is known of these is known of it.

    Behind an odd number of mirrors its z is turned round, away from where the lens looks: the frame is that of
    `RayCamera.central`.

    Attributes
    ----------
    rays
        The camera of rays.
    """

    rays: RayModel

    @cached_property
    def axes(self) -> Array:
        """(3,) the signs that turn directions of its frame into those of the rays', and back."""
        mirrors = self.rays.mirrors if isinstance(self.rays, Catadioptric) else ()
        return np.array([1.0, 1.0, -1.0 if len(mirrors) % 2 else 1.0])

    @property
    def theta_max(self) -> float:
        """The angle from the axis (radians) that bounds the valid cone."""
        return self.rays.theta_max

    @property
    def fold_angle(self) -> float:
        """The angle (radians) at which the image folds over: `theta_max`, unless that ends it earlier."""
        return self.rays.fold_angle

    @property
    def period(self) -> float | None:
        """The width in px after which the image repeats, if it does."""
        return self.rays.period

    def project(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Project points (..., 3), of which only the direction matters, to pixels (..., 2) and their validity."""
        return self.rays.project(self._far(points)[0])

    def project_numpy(self, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Do as `project` for points (N, 3)."""
        return self.rays.project_numpy(self._far(points)[0])

    def unproject(self, pixels: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Give the bearings (..., 3) of pixels (..., 2) and their validity."""
        _, bearings, valid = self.rays.rays(pixels)
        return bearings * self.axes, valid

    def unproject_numpy(self, pixels: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Do as `unproject` for pixels (N, 2)."""
        return self.unproject(pixels)

    def project_with_jacobians(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_], Array, Array]:
        """Project points and differentiate: pixels, valid, d_point (..., 2, 3) and d_params (..., 2, P)."""
        there, scale = self._far(points)
        pixels, valid, d_there, d_params = self.rays.project_with_jacobians(there)
        return pixels, valid, d_there * (scale * self.axes)[..., None, :], d_params

    def _far(self, points: ArrayLike) -> tuple[Array, Array]:
        """Give points (..., 3) in the frame of the rays, moved far away, and how many times farther (..., 1)."""
        directions = np.asarray(points, float)
        with np.errstate(all="ignore"):
            scale = FAR / np.linalg.norm(directions, axis=-1, keepdims=True)
        return scale * directions * self.axes, scale

    @classmethod
    def example(cls) -> Self:
        """Give a fisheye whose pupil moves, for a far scene."""
        return cls(Axial.example())


def far_camera(camera: RayCamera) -> Camera:
    """Give the central camera that a camera of rays is to a far scene, with its cone and its covariance."""
    model = CentralLimit(camera.model)
    cone: dict[str, Any] = {"theta_max": camera.theta_max, "theta_min": camera.theta_min}
    if model.axes[2] < 0:  # what is least is greatest from the other end
        last = None if camera.theta_min == 0 else np.pi - camera.theta_min
        cone = {"theta_max": last, "theta_min": 0.0 if camera.theta_max is None else np.pi - camera.theta_max}
    return Camera(model, camera.size, covariance=camera.covariance, **cone)


def from_viewpoint(state: State, model: RayModel, pixels: Array) -> State:
    """Give a state's boards as they stand around the point nearest to the rays of pixels (N, 2), in `CentralLimit`'s frame.

    Behind a mirror that exchanges left and right: points of boards are where they are seen, and rotations are none.
    """
    far = CentralLimit(model)
    centre = best_viewpoint(model, pixels).point
    return replace(
        state,
        model=far,
        rotations=far.axes[:, None] * state.rotations,
        translations=far.axes * (state.translations - centre),
    )
