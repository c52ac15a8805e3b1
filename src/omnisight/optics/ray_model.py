"""The protocol of a camera whose rays need not meet in a point."""

from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.geometry.rays import Rays
from omnisight.models._parametric import Parametric
from omnisight.models._protocol import Dip

Array = NDArray[np.float64]


class RayModel(Parametric):
    """Pixels to rays, and points to pixels: what `CameraModel` is to a central camera.

    The distance of a point matters here, so lengths have a unit: metres unless its maker says otherwise. `valid` means
    that the model shows the point, or that the pixel shows anything; what is not valid is NaN.
    """

    @classmethod
    def example(cls) -> Self:
        """Give a typical camera of this model, for tests and docs."""
        raise NotImplementedError

    @property
    def period(self) -> float | None:
        """The width in px after which the picture repeats (360 degrees), if it does."""
        return None

    @property
    def theta_max(self) -> float:
        """The angle from the frame's z axis (radians) past which it shows nothing."""
        return np.pi

    @property
    def fold_angle(self) -> float:
        """The angle (radians) at which the image folds over: `theta_max`, unless that ends it earlier."""
        return self.theta_max

    @property
    def rim(self) -> float:
        """NaN: no angle bounds the domain of rays that do not meet in a point."""
        return np.nan

    @property
    def dips(self) -> list[Dip]:
        """None: no angle tells where such an image nearly stops growing."""
        return []

    def rays(self, pixels: ArrayLike) -> Rays:
        """Give the rays (...) of pixels (..., 2), in the camera's frame."""
        raise NotImplementedError

    def project(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Project points (..., 3) of the camera's frame to pixels (..., 2), and say which are shown (...)."""
        raise NotImplementedError

    def project_numpy(self, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Do as `project` for points (N, 3), as solvers ask it."""
        return self.project(points)

    def project_with_jacobians(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_], Array, Array]:
        """Project points and differentiate.

        Returns
        -------
        pixels, valid
            As `project`.
        d_point
            (..., 2, 3), d pixel / d point.
        d_params
            (..., 2, P), d pixel / d params.
        """
        raise NotImplementedError
