"""The protocol of every camera model, central or not: what calibration and other solvers use."""

from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.models._parameterized import Parameterized

Array = NDArray[np.float64]
# A derivative for each of N points, (N,) or (K, N) for a tuple of K parameters; a float if it is the same for all.
Partial = Array | float


# A radius that increases, relative to the axis, more slowly than this nearly stops.
MIN_RELATIVE_GROWTH = 0.05


class NearFold(NamedTuple):
    """An angle at which the image radius nearly stops increasing with the angle.

    Attributes
    ----------
    angle
        Angle from the axis, radians.
    growth
        Slope of the radius there, relative to the slope on the axis.
    by_params
        (P,) derivative of `growth` by the parameters.
    """

    angle: float
    growth: float
    by_params: Array


class Projector(Parameterized):
    """A camera model as solvers see it: a parameter vector, and points to pixels with derivatives.

    `CameraModel` derives from it for central cameras and adds `unproject`; `RayModel` derives from it for non-central
    cameras and adds `rays`. `valid` means inside the model's one-to-one domain; invalid entries are NaN.
    """

    @classmethod
    def example(cls) -> Self:
        """Return a typical camera of this model, for tests and docs."""
        raise NotImplementedError

    @property
    def theta_max(self) -> float:
        """Angle from the axis (radians) that bounds the valid cone."""
        return np.pi

    @property
    def fold_angle(self) -> float:
        """Angle from the axis (radians) up to which the projection is injective, at most `theta_max`."""
        return self.theta_max

    @property
    def rim(self) -> float:
        """Angle from the axis (radians) at which the domain ends, planar distortion included; NaN if none bounds it."""
        return np.nan

    @cached_property
    def near_folds(self) -> list[NearFold]:
        """Angles at which the image radius nearly stops increasing: the domain would end there if it did stop."""
        return []

    @property
    def period(self) -> float | None:
        """Width in px after which the image repeats (360 degrees), or None."""
        return None

    def project(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Project points of the camera frame.

        Parameters
        ----------
        points
            (..., 3), x right, y down, z forward.

        Returns
        -------
        pixels
            (..., 2), NaN where not valid.
        valid
            (...), whether the point lies inside the model's one-to-one domain.

        Raises
        ------
        ValueError
            If the shape is not (..., 3).
        """
        raise NotImplementedError

    def project_numpy(self, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Project points (N, 3) without compiled code; for solvers, which project few points with many cameras."""
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

    def project_with_point_jacobian(self, points: Array) -> tuple[Array, NDArray[np.bool_], Array]:
        """Project points (N, 3); return pixels, valid and d_point of `project_with_jacobians`."""
        return self.project_with_jacobians(points)[:3]

    def rescaled(self, factor: float) -> Self:
        """Return the model of the image resized by a factor; a pixel centre c moves to (c + 1/2) factor - 1/2."""
        centre = np.array([0.5 if name in ("cx", "cy") else 0.0 for name in self.param_names])
        return self.with_params((self.params + centre) * self.rescaling(factor) - centre)

    def rescaling(self, factor: float) -> Array:
        """Return the derivatives (P,) of the parameters of `rescaled` by those of this model."""
        factors = np.ones(len(self.parameters))
        for i, parameter in enumerate(self.parameters):
            if parameter.unit == "px":
                factors[i] = factor
            elif parameter.name[0] == "a" and parameter.name[1:].isdigit():  # f(r) = a0 + a2 r^2 ... with r in pixels
                factors[i] = factor ** (1 - int(parameter.name[1:]))
        return factors
