"""Inertial measurement unit, wheel odometry and GNSS receiver on the simulated body."""

from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.geodesy import from_east_north_up
from omnisight.motion_sensor_options import RATES, GnssNoise, ImuNoise, MotionSensors, OdometryNoise
from omnisight.simulation.random_process import gauss_markov
from omnisight.simulation.spline_trajectory import SplineTrajectory

Array = NDArray[np.float64]
Rng = np.random.Generator
Noise = TypeVar("Noise", ImuNoise, OdometryNoise, GnssNoise)

# As in the files of EuRoC; m/s^2, downwards, which is +y of the world.
GRAVITY = 9.81
# Rows of the world's axes (x right, y down, z forward) as east, north and up.
EAST_NORTH_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
# Satellites are above the horizon only: the vertical error is about twice the horizontal one.
VERTICAL_GNSS_FACTOR = 2.0


class ImuMeasurements(NamedTuple):
    """Measurements of an IMU in the body frame at N times.

    Attributes
    ----------
    times
        (N,) seconds.
    angular_velocity, specific_force
        (N, 3) rad/s and m/s^2, with biases and noise.
    gyroscope_bias, accelerometer_bias
        (N, 3), true.
    """

    times: Array
    angular_velocity: Array
    specific_force: Array
    gyroscope_bias: Array
    accelerometer_bias: Array


class Odometry(NamedTuple):
    """Measurements of wheel odometry: times (N,), forward speed (N,) m/s, yaw rate (N,) rad/s, positive to the left."""

    times: Array
    speed: Array
    yaw_rate: Array


class Positions(NamedTuple):
    """Positions of a GNSS receiver.

    Attributes
    ----------
    times
        (N,) seconds.
    geodetic
        (N, 3) latitude and longitude, degrees, and altitude above the ellipsoid, metres.
    sigma
        (3,) standard deviations to the east, the north and upwards, metres.
    """

    times: Array
    geodetic: Array
    sigma: Array


def sample_times(start: float, end: float, rate: float) -> Array:
    """Return the times of samples at a rate from a start; the last one is not before the end."""
    return start + np.arange(int(np.ceil((end - start) * rate - 1e-9)) + 1) / rate


def measure_imu(motion: SplineTrajectory, times: Array, noise: ImuNoise, rng: Rng) -> ImuMeasurements:
    """Return the measurements of an IMU at the origin of the body frame, at regular times (N,).

    The specific force is R^T (a - g). White noise of a sample has the standard deviation density sqrt(rate), and a bias
    changes by steps of walk / sqrt(rate) (Trawny and Roumeliotis 2005, section 3).
    """
    true = motion.kinematics(times)
    force = np.einsum("nji,nj->ni", true.rotation, true.acceleration - np.array((0.0, GRAVITY, 0.0)))
    shape, step = (len(times), 3), _step(times)

    def bias(start: float, walk: float) -> Array:
        steps = rng.normal(0, walk * np.sqrt(step), shape)
        steps[0] = rng.normal(0, start, 3)
        return np.cumsum(steps, axis=0)

    gyroscope = bias(noise.gyroscope_bias, noise.gyroscope_walk)
    accelerometer = bias(noise.accelerometer_bias, noise.accelerometer_walk)
    return ImuMeasurements(
        times,
        true.angular_velocity + gyroscope + rng.normal(0, noise.gyroscope_density / np.sqrt(step), shape),
        force + accelerometer + rng.normal(0, noise.accelerometer_density / np.sqrt(step), shape),
        gyroscope,
        accelerometer,
    )


def measure_odometry(
    motion: SplineTrajectory, times: Array, vehicle_from_body: Array, noise: OdometryNoise, rng: Rng
) -> Odometry:
    """Return the measurements of wheel odometry at times (N,).

    Parameters
    ----------
    motion, times
        The motion of the body, and seconds.
    vehicle_from_body
        Rotation (3, 3) to the axes of the vehicle: x right, y down, z forward.
    noise, rng
        The noise and its source.
    """
    true = motion.kinematics(times)
    velocity = np.einsum("nji,nj->ni", true.rotation, true.velocity) @ vehicle_from_body.T
    scale, count = 1 + rng.normal(0, noise.scale), len(times)
    speed = velocity[:, 2] * scale + rng.normal(0, noise.speed, count)
    # y points down: a positive rotation about it is a turn to the right.
    yaw_rate = -(true.angular_velocity @ vehicle_from_body.T)[:, 1] + rng.normal(0, noise.yaw_rate, count)
    return Odometry(times, speed, yaw_rate)


def measure_gnss(
    motion: SplineTrajectory, times: Array, origin: tuple[float, float, float], noise: GnssNoise, rng: Rng
) -> Positions:
    """Return positions of a GNSS receiver at the origin of the body frame; east is +x of the world, north +z."""
    local = motion.kinematics(times).position @ EAST_NORTH_UP.T
    axes = np.array((1.0, 1.0, VERTICAL_GNSS_FACTOR))
    slow = noise.correlated * gauss_markov(times / noise.correlation_time, 3, rng)
    errors = axes * (slow + rng.normal(0, noise.white, local.shape))
    return Positions(times, from_east_north_up(local + errors, origin), axes * np.hypot(noise.correlated, noise.white))


def scaled(noise: Noise, factor: float) -> Noise:
    """Return a noise with all standard deviations multiplied by a factor."""
    return replace(noise, **{name: factor * value for name, value in vars(noise).items() if name != "correlation_time"})


def _step(times: Array) -> float:
    return float(times[-1] - times[0]) / (len(times) - 1) if len(times) > 1 else 1.0


@dataclass(frozen=True)
class MotionMeasurements:
    """Measurements of the sensors of the motion; None without the sensor."""

    imu: ImuMeasurements | None = None
    odometry: Odometry | None = None
    gnss: Positions | None = None


def measure_motion(
    sensors: MotionSensors,
    motion: SplineTrajectory,
    span: tuple[float, float],
    vehicle_from_body: Array,
    seed: int,
) -> MotionMeasurements:
    """Return the measurements of all sensors from the first to the last image.

    Parameters
    ----------
    sensors
        Rates and noise.
    motion
        The motion of the body.
    span
        Times of the first and the last image, seconds.
    vehicle_from_body
        Rotation (3, 3) to the axes of the vehicle: x right, y down, z forward.
    seed
        Of the noise; each sensor has its own source.
    """
    imu, odometry, gnss = (np.random.default_rng((seed, 1, 1, 1 + k)) for k in range(3))
    times = {name: sample_times(*span, rate) for name in RATES if (rate := getattr(sensors, name))}
    factor = sensors.noise
    return MotionMeasurements(
        measure_imu(motion, times["imu"], scaled(sensors.imu_noise, factor), imu) if sensors.imu else None,
        measure_odometry(motion, times["odometry"], vehicle_from_body, scaled(sensors.odometry_noise, factor), odometry)
        if sensors.odometry
        else None,
        measure_gnss(motion, times["gnss"], sensors.origin, scaled(sensors.gnss_noise, factor), gnss)
        if sensors.gnss
        else None,
    )
