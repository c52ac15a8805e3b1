"""How far the viewpoint of an axial camera moves along its axis, and how well that is known."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.optics.models.axial import Axial

Array = NDArray[np.float64]

STEPS = 181


@dataclass(frozen=True)
class PupilShift:
    """The place on the axis from where the ray at each angle starts, from that of the first ray on.

    A camera moved along its axis is the same camera: only the way between two places means anything.

    Attributes
    ----------
    theta
        (A,) angles from the axis, radians.
    place
        (A,) in the unit of the camera.
    effect
        (A, K) by how much a coefficient moves it.
    covariance
        (K, K) of the coefficients.
    """

    theta: Array
    place: Array
    effect: Array
    covariance: Array

    @classmethod
    def of(cls, model: Axial, covariance: Array, theta: Array, first: float) -> Self:
        """Give it at angles (A,), radians.

        Parameters
        ----------
        model
            The camera.
        covariance
            (P, P) of its parameters.
        theta
            (A,) the angles.
        first
            The angle that places count from.
        """
        count = len(model.pupil)
        alone = [Axial(model.lens, tuple(row)) for row in np.eye(count)]
        effect = np.stack([one.pupil_z(theta) - one.pupil_z(first) for one in alone], -1)
        return cls(theta, effect @ np.array(model.pupil), effect, covariance[-count:, -count:])

    @classmethod
    def between(cls, model: Axial, covariance: Array, cone: tuple[float, float]) -> Self:
        """Give it between two angles (radians)."""
        theta = np.linspace(cone[0], min(cone[1], model.theta_max), STEPS)
        return cls.of(model, covariance, theta, cone[0])

    @property
    def sigma(self) -> Array:
        """(A,) standard deviation of the place."""
        return self._sigma(self.effect)

    @property
    def length(self) -> float:
        """How far the viewpoint moves."""
        return float(np.ptp(self.place))

    @property
    def length_sigma(self) -> float:
        """Its standard deviation."""
        return float(self._sigma(self.effect[self.place.argmax()] - self.effect[self.place.argmin()]))

    def _sigma(self, effect: Array) -> Array:
        return np.sqrt(np.maximum(np.einsum("...i,ij,...j->...", effect, self.covariance, effect), 0.0))
