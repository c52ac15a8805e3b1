"""Central limit of a non-central camera: the central camera that it is for a distant scene."""

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.models import CameraModel
from omnisight.optics.catadioptric import Catadioptric
from omnisight.optics.models.axial import Axial
from omnisight.optics.ray_model import RayModel

Array = NDArray[np.float64]

# Distance (in the unit of the rays) at which the ray origins no longer matter.
FAR_DISTANCE = 1e9


@dataclass(frozen=True)
class CentralLimit(CameraModel):
    """A non-central camera for a distant scene: only the directions of its rays matter, not their origins.

    It has all parameters of the non-central model, so their covariance applies to it. After an odd number of
    mirrors, its z axis points away from the viewing direction of the lens, as in `RayCamera.central`.

    Attributes
    ----------
    rays
        The non-central model.
    """

    rays: RayModel

    @cached_property
    def axes(self) -> Array:
        """(3,) signs that convert directions between its frame and that of the rays."""
        mirrors = self.rays.mirrors if isinstance(self.rays, Catadioptric) else ()
        return np.array([1.0, 1.0, -1.0 if len(mirrors) % 2 else 1.0])

    @property
    def theta_max(self) -> float:
        """Angle from the axis (radians) that bounds the valid cone."""
        return self.rays.theta_max

    @property
    def fold_angle(self) -> float:
        """Angle from the axis (radians) up to which the projection is injective, at most `theta_max`."""
        return self.rays.fold_angle

    @property
    def period(self) -> float | None:
        """Width in px after which the image repeats, or None."""
        return self.rays.period

    def project(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Project points (..., 3), of which only the direction matters."""
        return self.rays.project(self._far(points)[0])

    def project_numpy(self, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Project points (N, 3), see `project`."""
        return self.rays.project_numpy(self._far(points)[0])

    def unproject(self, pixels: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Return the bearings (..., 3) of pixels (..., 2) and their validity."""
        _, bearings, valid = self.rays.rays(pixels)
        return bearings * self.axes, valid

    def unproject_numpy(self, pixels: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return the bearings of pixels (N, 2), see `unproject`."""
        return self.unproject(pixels)

    def project_with_jacobians(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_], Array, Array]:
        """Project points and differentiate: pixels, valid, d_point (..., 2, 3) and d_params (..., 2, P)."""
        there, scale = self._far(points)
        pixels, valid, d_there, d_params = self.rays.project_with_jacobians(there)
        return pixels, valid, d_there * (scale * self.axes)[..., None, :], d_params

    def _far(self, points: ArrayLike) -> tuple[Array, Array]:
        """Return points (..., 3) in the frame of the rays at `FAR_DISTANCE`, and their scale factors (..., 1)."""
        directions = np.asarray(points, float)
        with np.errstate(all="ignore"):
            scale = FAR_DISTANCE / np.linalg.norm(directions, axis=-1, keepdims=True)
        return scale * directions * self.axes, scale

    @classmethod
    def example(cls) -> Self:
        """Return a fisheye with an entrance pupil shift, for a distant scene."""
        return cls(Axial.example())
