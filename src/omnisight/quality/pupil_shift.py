"""Entrance pupil shift of an axial camera, with its standard deviation."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.optics.models.axial import Axial

Array = NDArray[np.float64]

# Angles at which the shift is sampled to find its extremes.
SAMPLES = 181


@dataclass(frozen=True)
class PupilShift:
    """The position on the axis of the ray origin as a function of the angle, relative to that at a reference angle.

    Moving a camera along its axis changes nothing, so only differences of positions are observable.

    Attributes
    ----------
    theta
        (A,) angles from the axis, radians.
    position
        (A,) along the axis, in the unit of the camera.
    by_coefficients
        (A, K) derivative by the coefficients.
    covariance
        (K, K) of the coefficients.
    """

    theta: Array
    position: Array
    by_coefficients: Array
    covariance: Array

    @classmethod
    def of(cls, model: Axial, covariance: Array, theta: Array, reference: float) -> Self:
        """Evaluate the shift.

        Parameters
        ----------
        model
            The camera.
        covariance
            (P, P) of its parameters.
        theta
            (A,) angles from the axis, radians.
        reference
            Angle of zero shift, radians.
        """
        count = len(model.pupil)
        basis = [Axial(model.lens, tuple(row)) for row in np.eye(count)]
        by_coefficients = np.stack([term.pupil_z(theta) - term.pupil_z(reference) for term in basis], -1)
        shift = by_coefficients @ np.array(model.pupil)
        return cls(theta, shift, by_coefficients, covariance[-count:, -count:])

    @classmethod
    def between(cls, model: Axial, covariance: Array, cone: tuple[float, float]) -> Self:
        """Evaluate the shift between two angles (radians)."""
        theta = np.linspace(cone[0], min(cone[1], model.theta_max), SAMPLES)
        return cls.of(model, covariance, theta, cone[0])

    @property
    def sigma(self) -> Array:
        """(A,) standard deviation of the position."""
        return self._sigma(self.by_coefficients)

    @property
    def length(self) -> float:
        """Distance between the extreme positions."""
        return float(np.ptp(self.position))

    @property
    def length_sigma(self) -> float:
        """Standard deviation of `length`."""
        first, last = self.position.argmin(), self.position.argmax()
        return float(self._sigma(self.by_coefficients[last] - self.by_coefficients[first]))

    def _sigma(self, derivative: Array) -> Array:
        variance = np.einsum("...i,ij,...j->...", derivative, self.covariance, derivative)
        return np.sqrt(np.maximum(variance, 0.0))
