"""The scale of a trajectory from an inertial measurement unit."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.visual_odometry.gyro_prediction import MIN_TURN_RAD
from omnisight.visual_odometry.imu import ImuSamples, Preintegration
from omnisight.visual_odometry.scale_estimate import ScaleEstimate

Array = NDArray[np.float64]

# Time (seconds) between the poses that are used.
STEP_S = 0.3
# Steps below which the unknowns (scale, gravity, bias, lever) are not determined well.
MIN_STEPS = 8
# Standard gravity, and the deviation of its value on the surface of the earth, m/s^2.
GRAVITY, GRAVITY_SIGMA = 9.81, 0.03
# Standard deviations of the bias of the accelerometer (m/s^2) and of the position (m) of the IMU on the camera.
BIAS_SIGMA, LEVER_SIGMA = 0.2, 0.1
# Standard deviations of integrated velocities (m/s) and positions (m) over a step, which the residuals correct.
VELOCITY_SIGMA, POSITION_SIGMA = 0.02, 0.005
# Rounds in which the bias and the orientation, or the noise and the direction of gravity, are estimated in turn.
ROUNDS = 8
# Angle (degrees) between turns of the images and of the gyroscope above which their clocks or frames are different.
MAX_TURN_ERROR_DEG = 1.0
SOURCE = "the IMU"


@dataclass(frozen=True, eq=False)
class Orientation:
    """Orientation rig_from_imu (3, 3), bias (3,) of the gyroscope, and the rms angle of what they do not explain."""

    rig_from_imu: Array
    bias: Array
    residual_deg: float


def scale_from_imu(times: Array, poses: list[Pose], imu: ImuSamples) -> ScaleEstimate:
    """Return the scale of poses world_from_rig at times (N,) by inertial measurements.

    Positions, velocities, gravity, the bias of the accelerometer and the position of the IMU are linear in the
    preintegrated measurements (T. Qin and S. Shen, Robust initialization of monocular visual-inertial estimation on
    aerial robots, IROS 2017); the length of gravity is known. The standard deviation is that of least squares with the
    noise of the residuals.
    """
    rows = _spaced(times)
    intervals = [imu.between(times[a], times[b]) for a, b in pairwise(rows)]
    if len(intervals) < MIN_STEPS or any(samples is None for samples in intervals):
        return ScaleEstimate(
            SOURCE,
            reason=f"inertial measurements from {imu.times[0]:.3f} to {imu.times[-1]:.3f} s must cover the images, from"
            f" {times[0]:.3f} to {times[-1]:.3f} s, with {MIN_STEPS * STEP_S:.1f} s or more",
        )
    samples = [each for each in intervals if each is not None]
    used = [poses[row] for row in rows]
    orientation = _orientation(used, samples)
    if orientation is None:
        return ScaleEstimate(
            SOURCE,
            reason="the camera hardly turns, or about one axis only, so the IMU's orientation is unknown: turn it"
            " about two",
        )
    if orientation.residual_deg > MAX_TURN_ERROR_DEG:
        return ScaleEstimate(
            SOURCE,
            reason=f"turns of the images and of the gyroscope differ by {orientation.residual_deg:.1f}°:"
            " are their times of the same clock, and angular velocities in rad/s?",
        )
    steps = [Preintegration.of(each, orientation.bias) for each in samples]
    imus = [Pose(pose.rotation @ orientation.rig_from_imu, pose.translation) for pose in used]
    scale, sigma = _solve(imus, steps)
    return ScaleEstimate.checked(SOURCE, scale, abs(sigma / scale))


def _spaced(times: Array) -> list[int]:
    """Return indices of times that are apart."""
    rows = [0]
    for row, seconds in enumerate(times):
        if seconds - times[rows[-1]] >= STEP_S - 1e-6:
            rows.append(row)
    return rows


def _orientation(poses: list[Pose], samples: list[ImuSamples]) -> Orientation | None:
    """Align the turns of poses world_from_rig with those of the gyroscope; None if they are not about two axes."""
    turns = np.array([so3.log(b.rotation.T @ a.rotation) for a, b in pairwise(poses)])
    bias = np.zeros(3)
    rotation, difference = np.eye(3), turns
    seconds = np.array([each.times[-1] - each.times[0] for each in samples])
    for _ in range(ROUNDS):
        measured = np.array([so3.log(Preintegration.of(each, bias).rotation.T) for each in samples])
        u, values, v = np.linalg.svd(turns.T @ measured)
        if values[1] < max(1e-3 * values[0], MIN_TURN_RAD**2):
            return None
        rotation = np.asarray(u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v, float)
        difference = turns @ rotation - measured
        # The turn end_from_start is the negative of the integral of the rate.
        bias = bias + np.median(difference / seconds[:, None], axis=0)
    return Orientation(rotation, bias, float(np.degrees(np.sqrt((difference**2).sum(axis=1).mean()))))


def _solve(poses: list[Pose], steps: list[Preintegration]) -> tuple[float, float]:
    """Return the scale and its standard deviation from world_from_imu, whose positions are those of the camera.

    Unknowns: scale, gravity, bias, position of the IMU in its frame, and a velocity for each pose.
    """
    count = 10 + 3 * len(poses)
    rows, values = list[Array](), list[Array]()
    for k, ((a, b), step) in enumerate(zip(pairwise(poses), steps, strict=True)):
        position, velocity = np.zeros((3, count)), np.zeros((3, count))
        position[:, 0] = b.translation - a.translation
        position[:, 1:4] = -np.eye(3) * step.seconds**2 / 2
        position[:, 4:7] = -a.rotation @ step.position_by_bias
        position[:, 7:10] = b.rotation - a.rotation
        position[:, 10 + 3 * k : 13 + 3 * k] = -np.eye(3) * step.seconds
        velocity[:, 1:4] = -np.eye(3) * step.seconds
        velocity[:, 4:7] = -a.rotation @ step.velocity_by_bias
        velocity[:, 10 + 3 * k : 13 + 3 * k] = -np.eye(3)
        velocity[:, 13 + 3 * k : 16 + 3 * k] = np.eye(3)
        rows += [position / POSITION_SIGMA, velocity / VELOCITY_SIGMA]
        values += [a.rotation @ step.position / POSITION_SIGMA, a.rotation @ step.velocity / VELOCITY_SIGMA]
    matrix, right = np.concatenate(rows), np.concatenate(values)
    prior = np.zeros((6, count))
    prior[:3, 4:7], prior[3:, 7:10] = np.eye(3) / BIAS_SIGMA, np.eye(3) / LEVER_SIGMA
    noise = 1.0
    gravity = np.zeros((0, count))
    known = np.zeros(0)
    solution, information = np.zeros(count), np.eye(count)
    for _ in range(ROUNDS):
        system = np.concatenate([matrix / noise, prior, gravity])
        solution = np.linalg.lstsq(system, np.concatenate([right / noise, np.zeros(6), known]), rcond=None)[0]
        information = system.T @ system
        residuals = matrix @ solution - right
        noise = max(float(np.sqrt((residuals**2).sum() / max(len(right) + 7 - count, 1))), 1e-9)
        direction = solution[1:4] / max(float(np.linalg.norm(solution[1:4])), 1e-9)
        gravity = np.zeros((1, count))
        gravity[0, 1:4] = direction / GRAVITY_SIGMA
        known = np.array([GRAVITY / GRAVITY_SIGMA])
    sigma = float(np.sqrt(np.linalg.pinv(information, hermitian=True)[0, 0]))
    return float(solution[0]), sigma
