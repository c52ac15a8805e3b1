"""Sensors of the motion: exact measurements integrate to the trajectory, and noise has the stated statistics."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import omnisight as om
from omnisight.geometry.geodesy import east_north_up
from omnisight.geometry.rotation import exp
from omnisight.motion_sensor_options import GnssNoise, ImuNoise, MotionSensors, OdometryNoise
from omnisight.simulation.motion_sensors import (
    GRAVITY,
    measure_gnss,
    measure_imu,
    measure_odometry,
    sample_times,
    scaled,
)
from omnisight.simulation.preset_motion import preset_trajectory
from omnisight.simulation.random_process import gauss_markov
from omnisight.simulation.spline_trajectory import SplineTrajectory
from omnisight.simulation.trajectory import Trajectory

ORIGIN = (47.3769, 8.5417, 408.0)
EXACT_IMU = scaled(ImuNoise(), 0.0)


def rng(seed=0):
    return np.random.default_rng(seed)


def tumbling(count=12, step=0.5):
    draw = rng(1)
    turn, poses = np.eye(3), []
    for place in np.cumsum(draw.normal(0, 0.4, (count, 3)), axis=0):
        turn = turn @ exp(draw.normal(0, 0.5, 3))
        poses.append(om.Pose(turn, place))
    return Trajectory(step * np.arange(count), tuple(poses))


def test_spline_passes_through_sparse_poses_and_has_a_continuous_acceleration():
    trajectory = tumbling()
    spline = SplineTrajectory.fit(trajectory)
    assert spline.deviation(trajectory) == pytest.approx((0, 0), abs=1e-7)
    for knot in trajectory.times[1:-1]:
        before, after = (spline.kinematics([knot + step]) for step in (-1e-9, 1e-9))
        for a, b in zip(before, after, strict=True):
            np.testing.assert_allclose(a, b, atol=1e-6)


def test_spline_follows_dense_poses_of_a_walk():
    trajectory = preset_trajectory("loop", ((-1.5, -0.2, -1.5), (1.5, 0.2, 1.5)))
    distance, angle = SplineTrajectory.fit(trajectory).deviation(trajectory)
    assert distance < 2e-3
    assert angle < 2e-3


def test_kinematics_are_the_derivatives_of_the_poses():
    spline, times, step = SplineTrajectory.fit(tumbling()), np.linspace(0.31, 5.13, 40), 1e-5
    here, before, after = (spline.kinematics(times + d) for d in (0, -step, step))
    np.testing.assert_allclose(here.velocity, (after.position - before.position) / (2 * step), atol=1e-6)
    np.testing.assert_allclose(here.acceleration, (after.velocity - before.velocity) / (2 * step), atol=1e-5)
    turn = Rotation.from_matrix(np.swapaxes(before.rotation, 1, 2) @ after.rotation).as_rotvec()
    np.testing.assert_allclose(here.angular_velocity, turn / (2 * step), atol=1e-6)


def test_body_rests_after_the_end():
    trajectory = preset_trajectory("line", ((-1.0, 0.0, -4.0), (1.0, 0.0, 4.0)))
    spline = SplineTrajectory.fit(trajectory, end=float(trajectory.times[-1]) + 3)
    rest = spline.kinematics(trajectory.times[-1] + np.array((1.5, 2.5, 9.0)))
    np.testing.assert_allclose(rest.position[2], trajectory.poses[-1].translation, atol=1e-3)
    np.testing.assert_allclose(rest.velocity, 0, atol=1e-3)
    np.testing.assert_allclose(rest.acceleration, 0, atol=1e-2)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_short_trajectories_have_splines(count):
    trajectory = tumbling(count)
    spline = SplineTrajectory.fit(trajectory)
    assert spline.deviation(trajectory) == pytest.approx((0, 0), abs=1e-7)
    assert np.isfinite(spline.kinematics(trajectory.times).acceleration).all()


def test_exact_imu_integrates_to_the_trajectory():
    """Strapdown integration at the midpoints, with gravity along +y of the world."""
    spline, rate = SplineTrajectory.fit(tumbling()), 2000.0
    imu = measure_imu(spline, sample_times(0.0, 5.5, rate), EXACT_IMU, rng())
    assert not imu.gyroscope_bias.any()
    start = spline.kinematics([0.0])
    turn, velocity, place = start.rotation[0], start.velocity[0].copy(), start.position[0].copy()
    means = [(samples[1:] + samples[:-1]) / 2 for samples in (imu.angular_velocity, imu.specific_force)]
    for angular, force in zip(*means, strict=True):
        half = turn @ exp(angular / rate / 2)
        acceleration = half @ force + (0, GRAVITY, 0)
        place += velocity / rate + acceleration / rate**2 / 2
        velocity += acceleration / rate
        turn = turn @ exp(angular / rate)
    end = spline.kinematics([imu.times[-1]])
    np.testing.assert_allclose(turn, end.rotation[0], atol=1e-5)
    np.testing.assert_allclose(velocity, end.velocity[0], atol=1e-4)
    np.testing.assert_allclose(place, end.position[0], atol=1e-4)


def test_imu_at_rest_measures_the_reaction_to_gravity():
    spline = SplineTrajectory.fit(Trajectory(np.array((0.0,)), (om.Pose(),)))
    imu = measure_imu(spline, sample_times(0.0, 1.0, 10.0), EXACT_IMU, rng())
    np.testing.assert_allclose(imu.specific_force, np.tile((0, -GRAVITY, 0), (11, 1)))
    np.testing.assert_array_equal(imu.angular_velocity, 0)


def test_imu_noise_has_the_stated_densities():
    spline = SplineTrajectory.fit(Trajectory(np.array((0.0,)), (om.Pose(),)))
    noise = ImuNoise(gyroscope_bias=0.0, accelerometer_bias=0.0)
    rate, times = 200.0, sample_times(0.0, 500.0, 200.0)
    imu, exact = (measure_imu(spline, times, n, rng(3)) for n in (noise, EXACT_IMU))
    cases = (
        (imu.angular_velocity - exact.angular_velocity, imu.gyroscope_bias, "gyroscope"),
        (imu.specific_force - exact.specific_force, imu.accelerometer_bias, "accelerometer"),
    )
    for error, bias, name in cases:
        density, walk = getattr(noise, f"{name}_density"), getattr(noise, f"{name}_walk")
        np.testing.assert_allclose((error - bias).std(0), density * np.sqrt(rate), rtol=0.02)
        # A bias changes by walk sqrt(tau) in a time tau.
        for lag in (1, 20):
            change = (bias[lag:] - bias[:-lag])[::lag]
            np.testing.assert_allclose(change.std(), walk * np.sqrt(lag / rate), rtol=0.05)
        # Allan deviation of the white noise at 0.5 s: density / sqrt(tau).
        means = (error - bias)[:100_000].reshape(-1, 100, 3).mean(1)
        allan = np.sqrt((np.diff(means, axis=0) ** 2).mean() / 2)
        assert allan == pytest.approx(density / np.sqrt(0.5), rel=0.05)


def test_biases_at_the_beginning_have_the_stated_deviation():
    spline = SplineTrajectory.fit(Trajectory(np.array((0.0,)), (om.Pose(),)))
    first = [measure_imu(spline, np.array((0.0,)), ImuNoise(), rng(seed)).gyroscope_bias for seed in range(300)]
    assert np.std(first) == pytest.approx(ImuNoise().gyroscope_bias, rel=0.1)


@pytest.mark.parametrize("up", ["top", "back", "front"])
def test_odometry_is_that_of_the_vehicle_for_any_camera_orientation(up):
    """A left turn of radius 5 m at 2 m/s: y points down, so that the yaw decreases."""
    times, radius, speed = np.arange(0, 3, 0.05), 5.0, 2.0
    angle = speed / radius * times
    poses = tuple(
        om.Pose(exp((0, -a, 0)) @ om.look(up=up), radius * np.array((np.cos(a) - 1, 0, np.sin(a)))) for a in angle
    )
    spline = SplineTrajectory.fit(Trajectory(times, poses))
    odometry = measure_odometry(spline, times[5:-5], om.look(up=up), scaled(OdometryNoise(), 0.0), rng())
    np.testing.assert_allclose(odometry.speed, speed, atol=1e-3)
    np.testing.assert_allclose(odometry.yaw_rate, speed / radius, atol=1e-3)


def test_odometry_noise():
    spline = SplineTrajectory.fit(Trajectory(np.array((0.0,)), (om.Pose(),)))
    noisy = measure_odometry(spline, np.arange(5000.0), np.eye(3), OdometryNoise(), rng())
    assert noisy.speed.std() == pytest.approx(OdometryNoise().speed, rel=0.05)
    assert noisy.yaw_rate.std() == pytest.approx(OdometryNoise().yaw_rate, rel=0.05)


def test_exact_gnss_is_the_position_east_north_and_up_of_the_origin():
    spline, times = SplineTrajectory.fit(tumbling()), np.arange(0, 5.0)
    gnss = measure_gnss(spline, times, ORIGIN, scaled(GnssNoise(), 0.0), rng())
    x, y, z = spline.kinematics(times).position.T
    np.testing.assert_allclose(east_north_up(gnss.geodetic, ORIGIN), np.stack([x, z, -y], -1), atol=1e-6)


def test_gnss_noise_has_the_stated_deviation_and_is_correlated():
    spline = SplineTrajectory.fit(Trajectory(np.array((0.0,)), (om.Pose(),)))
    gnss = measure_gnss(spline, np.arange(20_000.0), ORIGIN, GnssNoise(correlation_time=10.0), rng())
    error = east_north_up(gnss.geodetic, ORIGIN)
    np.testing.assert_allclose(error.std(0), gnss.sigma, rtol=0.1)
    assert gnss.sigma[2] == 2 * gnss.sigma[0]
    correlation = (error[:-10] * error[10:]).mean(0) / GnssNoise().correlated ** 2 / (1, 1, 4)
    np.testing.assert_allclose(correlation, np.exp(-1), atol=0.1)


def test_gauss_markov_is_stationary():
    drawn = gauss_markov(0.05 * np.arange(400), 500, rng())
    assert drawn[0].std() == pytest.approx(1, abs=0.1)
    assert drawn[-1].std() == pytest.approx(1, abs=0.1)
    assert np.mean(drawn[:-20] * drawn[20:]) == pytest.approx(np.exp(-1), abs=0.05)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"imu": -1.0}, "--imu must be from 0 to 10000 Hz"),
        ({"gnss": float("nan")}, "--gnss must be"),
        ({"noise": -1.0}, "--sensor-noise must be a factor"),
        (
            {"origin": (91.0, 0.0, 0.0)},
            "--origin must be .* in degrees and metres, got 91,0,0",
        ),
    ],
)
def test_invalid_values_are_rejected(values, message):
    with pytest.raises(ValueError, match=message):
        MotionSensors(**values)
