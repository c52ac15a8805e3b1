"""Twice continuously differentiable trajectories, and the velocities and accelerations along them."""

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline, make_lsq_spline
from scipy.spatial.transform import Rotation

from omnisight.geometry.pose import Pose
from omnisight.simulation.trajectory import Motion, Trajectory

Array = NDArray[np.float64]

DEGREE = 3
# Least time between knots: motions of up to 5 Hz are kept, and noise of densely measured poses is not differentiated.
MIN_KNOT_STEP_S = 0.1


class Kinematics(NamedTuple):
    """Motion of a body at N times.

    Attributes
    ----------
    rotation
        (N, 3, 3) world_from_body.
    position, velocity, acceleration
        (N, 3) in the world frame, metres and seconds.
    angular_velocity
        (N, 3) in the body frame, radians per second.
    """

    rotation: Array
    position: Array
    velocity: Array
    acceleration: Array
    angular_velocity: Array


@dataclass(frozen=True, eq=False)
class SplineTrajectory(Motion):
    """A cubic B-spline of positions and quaternions, the latter normalized, as in Kim, Kim and Shin 1995, section 2.

    Before the first and after the last knot the body rests at the pose there.

    Attributes
    ----------
    spline
        Position and quaternion x y z w (7,) as a function of time, seconds.
    times
        (2,) beginning and end.
    """

    spline: BSpline
    times: Array

    @classmethod
    def fit(cls, trajectory: Trajectory, end: float | None = None) -> Self:
        """Fit a spline to poses: exact if they are at least 0.1 s apart, otherwise least squares with such knots.

        Parameters
        ----------
        trajectory
            The poses.
        end
            Time up to which the body rests at the last pose, if it is after it.
        """
        times, places = trajectory.times, np.array([pose.translation for pose in trajectory.poses])
        turns = Rotation.from_matrix(np.array([pose.rotation for pose in trajectory.poses])).as_quat()
        # q and -q are the same rotation: choose the sign that continues.
        signs = np.cumprod(np.where((turns[1:] * turns[:-1]).sum(1) < 0, -1.0, 1.0))
        turns[1:] *= signs[:, None]
        values = np.column_stack([places, turns])
        if end is not None and end - times[-1] > MIN_KNOT_STEP_S:
            rest = np.arange(times[-1] + MIN_KNOT_STEP_S, end + MIN_KNOT_STEP_S, MIN_KNOT_STEP_S)
            times = np.append(times, rest)
            values = np.concatenate([values, np.tile(values[-1], (len(rest), 1))])
        if len(times) == 1:
            return cls(BSpline(np.array([times[0], times[0] + 1]), values, 0), times[[0, 0]])
        sites = _sites(times)
        degree = min(DEGREE, len(sites) - 1)
        inner = sites[2:-2] if degree == DEGREE else sites[:0]  # not-a-knot ends
        knots = np.concatenate([np.repeat(sites[0], degree + 1), inner, np.repeat(sites[-1], degree + 1)])
        return cls(make_lsq_spline(times, values, knots, degree), times[[0, -1]])

    def at(self, time: float) -> Pose:
        """Return world_from_body at a time."""
        value = self.spline(np.clip(time, *self.times))
        return Pose(Rotation.from_quat(value[3:]).as_matrix(), value[:3])

    def kinematics(self, times: ArrayLike) -> Kinematics:
        """Return the pose, velocities and acceleration at times (N,); derivatives are analytic."""
        asked = np.asarray(times, float)
        inside = np.clip(asked, *self.times)
        moves = (asked == inside)[:, None] & (self.times[0] < self.times[1])
        value = self.spline(inside)
        rate, second = (self.spline(inside, k) * moves if k <= self.spline.k else 0 * value for k in (1, 2))
        length = np.linalg.norm(value[:, 3:], axis=1, keepdims=True)
        q = value[:, 3:] / length
        dq = rate[:, 3:] / length
        # The angular velocity in the body frame is twice the vector part of conj(q) dq; a change of length has none.
        v, w = q[:, :3], q[:, 3:]
        angular = 2 * (w * dq[:, :3] - dq[:, 3:] * v - np.cross(v, dq[:, :3]))
        rotation = Rotation.from_quat(q).as_matrix()
        return Kinematics(rotation, value[:, :3], rate[:, :3], second[:, :3], angular)

    def deviation(self, trajectory: Trajectory) -> tuple[float, float]:
        """Return the largest distance (metres) and angle (radians) between poses and the spline."""
        fitted = self.kinematics(trajectory.times)
        places = np.array([pose.translation for pose in trajectory.poses])
        rotations = np.array([pose.rotation for pose in trajectory.poses])
        angles = Rotation.from_matrix(np.swapaxes(rotations, 1, 2) @ fitted.rotation).magnitude()
        return float(np.linalg.norm(places - fitted.position, axis=1).max()), float(angles.max())


def _sites(times: Array) -> Array:
    """Return the times of knots: the first and the last pose, and poses at least 0.1 s apart between them."""
    chosen = [float(times[0])]
    for time in times[1:].tolist():
        if time - chosen[-1] >= MIN_KNOT_STEP_S * (1 - 1e-9):
            chosen.append(time)
    if chosen[-1] < times[-1]:
        chosen = [*chosen[:-1], float(times[-1])] if len(chosen) > 1 else [*chosen, float(times[-1])]
    return np.array(chosen)
