"""Measurements of an inertial measurement unit, and their integrals between images."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry import rotation as so3

Array = NDArray[np.float64]

# Longest time (seconds) between samples.
MAX_GAP_S = 0.1


class ImuSamples(NamedTuple):
    """Times (N,), seconds, angular velocities (N, 3), rad/s, and specific forces (N, 3), m/s^2, in the IMU's frame."""

    times: Array
    angular_velocity: Array
    specific_force: Array

    def between(self, start: float, end: float) -> "ImuSamples | None":
        """Return the samples from a start to an end, interpolated there; None if they are not known."""
        if start < self.times[0] - 1e-6 or end > self.times[-1] + 1e-6 or end <= start:
            return None
        first, last = np.searchsorted(self.times, [start + 1e-9, end - 1e-9], side="left")
        times = np.concatenate([[start], self.times[first:last], [end]])
        if np.diff(times).max() > MAX_GAP_S:
            return None
        near = slice(max(first - 1, 0), last + 1)
        values = [
            np.stack([np.interp(times, self.times[near], column) for column in rows[near].T], -1)
            for rows in (self.angular_velocity, self.specific_force)
        ]
        return ImuSamples(times, *values)


class Preintegration(NamedTuple):
    """Integrals over an interval, in the IMU's frame at its start, by the midpoint rule.

    C. Forster et al., On-manifold preintegration for real-time visual-inertial odometry, TRO 33, 2017.

    Attributes
    ----------
    seconds
        Length of the interval.
    rotation
        (3, 3) start_from_end.
    velocity, position
        (3,) once and twice integrated specific force.
    velocity_by_bias, position_by_bias
        (3, 3) derivatives by the bias of the accelerometer.
    """

    seconds: float
    rotation: Array
    velocity: Array
    position: Array
    velocity_by_bias: Array
    position_by_bias: Array

    @classmethod
    def of(cls, samples: ImuSamples, gyroscope_bias: Array) -> "Preintegration":
        """Integrate samples, after subtracting a bias (3,) from their angular velocities."""
        rotation, velocity, position = np.eye(3), np.zeros(3), np.zeros(3)
        by_velocity, by_position = np.zeros((3, 3)), np.zeros((3, 3))
        steps = np.diff(samples.times)
        rates = (samples.angular_velocity[1:] + samples.angular_velocity[:-1]) / 2 - gyroscope_bias
        forces = (samples.specific_force[1:] + samples.specific_force[:-1]) / 2
        turns = so3.exp(rates * steps[:, None])
        halves = so3.exp(rates * steps[:, None] / 2)
        for step, force, turn, half in zip(steps, forces, turns, halves, strict=True):
            middle = rotation @ half
            position = position + velocity * step + middle @ force * step**2 / 2
            by_position = by_position + by_velocity * step - middle * step**2 / 2
            velocity = velocity + middle @ force * step
            by_velocity = by_velocity - middle * step
            rotation = rotation @ turn
        seconds = float(samples.times[-1] - samples.times[0])
        return cls(seconds, rotation, velocity, position, by_velocity, by_position)
