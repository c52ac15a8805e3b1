"""Scale from wheels, the ground and an IMU, on exact trajectories with noise."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

import omnisight as om
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.motion_sensor_options import ImuNoise
from omnisight.pipeline.odometry.motion_files import read_imu, read_wheels
from omnisight.pipeline.odometry.odometry import _in_metres
from omnisight.pipeline.odometry.odometry_scale import ScaleSources
from omnisight.simulation.motion_sensors import measure_imu
from omnisight.simulation.spline_trajectory import SplineTrajectory
from omnisight.simulation.trajectory import Trajectory
from omnisight.visual_odometry.frame_result import LostSegment, TrackedPose
from omnisight.visual_odometry.ground_plane import GroundHeight, ground_height, scale_from_height
from omnisight.visual_odometry.gyro_prediction import GyroPrediction
from omnisight.visual_odometry.imu import ImuSamples
from omnisight.visual_odometry.imu_scale import scale_from_imu
from omnisight.visual_odometry.loop_result import Loop, LoopClosure
from omnisight.visual_odometry.scale_estimate import robust_mean
from omnisight.visual_odometry.wheel_scale import WheelSpeeds, scale_from_wheels

METRES_PER_UNIT = 2.5
DOWN = np.array([0.0, 1.0, 0.0])


@pytest.fixture(scope="module")
def motion():
    """A person who carries a camera for twelve seconds."""
    times = np.arange(0, 12.01, 0.1)
    centers = np.stack([1.5 * np.sin(0.9 * times), 0.1 * np.sin(4 * times), 2 * np.cos(0.7 * times)], -1)
    turns = 0.4 * np.sin(np.outer(times, [0.8, 0.5, 0.6]) + np.arange(3))
    poses = tuple(Pose(so3.exp(turn), center) for turn, center in zip(turns, centers, strict=True))
    return SplineTrajectory.fit(Trajectory(times, poses), end=12.0)


def seen(motion, seed=0, noise=0.001):
    """Return times, and poses world_from_rig in units as odometry returns them."""
    times = np.arange(0, 11.9, 0.1)
    true, rng = motion.kinematics(times), np.random.default_rng(seed)
    centers = true.position / METRES_PER_UNIT + noise * rng.normal(size=(len(times), 3))
    return times, [Pose(r, c) for r, c in zip(true.rotation, centers, strict=True)]


def inertial(motion, seed=0, rotation=np.eye(3), noise=ImuNoise()):  # noqa: B008
    times = np.arange(0, 12.0, 0.005)
    found = measure_imu(motion, times, noise, np.random.default_rng(seed))
    return ImuSamples(times, found.angular_velocity @ rotation, found.specific_force @ rotation)


@pytest.mark.parametrize("angle", [0.0, 1.0])
def test_an_imu_of_any_orientation_determines_the_scale(motion, angle):
    rotation = so3.exp(angle * np.array([0.6, 0.5, -0.4]))
    times, poses = seen(motion)
    found = scale_from_imu(times, poses, inertial(motion, rotation=rotation))
    assert found
    assert found.metres == pytest.approx(METRES_PER_UNIT, rel=4 * found.relative_sigma)
    assert found.relative_sigma < 0.03


def test_the_uncertainty_of_the_scale_of_an_imu_is_that_of_its_errors(motion):
    errors = []
    for seed in range(12):
        times, poses = seen(motion, seed)
        found = scale_from_imu(times, poses, inertial(motion, seed))
        errors.append(np.log(found.metres / METRES_PER_UNIT) / found.relative_sigma)
    assert 0.4 < np.sqrt(np.mean(np.square(errors))) < 1.8


def test_without_acceleration_the_scale_of_an_imu_is_unknown():
    times = np.arange(0, 12.01, 0.1)
    turns = 0.4 * np.sin(np.outer(times, [0.8, 0.5, 0.6]) + np.arange(3))
    poses = tuple(Pose(so3.exp(turn), np.array([0.7 * t, 0, 0])) for turn, t in zip(turns, times, strict=True))
    steady = SplineTrajectory.fit(Trajectory(times, poses), end=12.0)
    found = scale_from_imu(*seen(steady), inertial(steady))
    assert not found
    assert "uncertain by" in found.reason


def test_noise_of_a_camera_that_does_not_turn_is_no_orientation_of_an_imu(motion):
    times, rng = np.arange(0, 12.01, 0.1), np.random.default_rng(0)
    centers = motion.kinematics(times).position
    rail = SplineTrajectory.fit(Trajectory(times, tuple(Pose(np.eye(3), center) for center in centers)), end=12.0)
    times, poses = seen(rail)
    noisy = [Pose(so3.exp(rng.normal(0, 4e-4, 3)), pose.translation) for pose in poses]
    found = scale_from_imu(times, noisy, inertial(rail, rotation=so3.exp(np.array([0.6, 0.5, -0.4]))))
    assert not found
    assert "hardly turns" in found.reason


def test_an_imu_of_another_time_or_camera_is_refused(motion):
    times, poses = seen(motion)
    assert "must cover the images" in scale_from_imu(times + 100, poses, inertial(motion)).reason
    imu = inertial(motion)
    other = imu._replace(angular_velocity=imu.angular_velocity[::-1])
    assert "differ by" in scale_from_imu(times, poses, other).reason


def test_samples_of_an_interval_are_interpolated_at_its_ends():
    times = np.arange(2_000) / 200.0
    table = ImuSamples(times, *(np.stack([np.sin(times), times, -times], -1) for _ in range(2)))
    for start, end in ((4.001, 4.1), (0.0, 0.05), (times[-9], times[-1]), (7.0, 7.003)):
        found = table.between(start, end)
        assert (found.times[0], found.times[-1]) == (start, end)
        assert np.allclose(found.angular_velocity[:, 1], found.times, atol=1e-9)
        assert found.times[1:-1].tolist() == [t for t in times.tolist() if start + 1e-9 < t < end - 1e-9]


def test_a_gyroscope_predicts_turns_once_its_orientation_is_known(motion):
    rotation = so3.exp(np.array([0.5, -0.8, 0.3]))
    gyro = GyroPrediction(inertial(motion, rotation=rotation))
    times, poses = seen(motion)
    assert gyro.rig_from_imu is None
    before = poses[49].inverse()
    assert gyro.turned(Pose(), before, (times[49], times[50])) == Pose()
    for k in range(49):
        turn = so3.log(poses[k + 1].rotation.T @ poses[k].rotation)
        gyro.learn((times[k], times[k + 1]), turn)
    predicted = gyro.turned(Pose(), before, (times[49], times[50]))
    error = so3.log(predicted.rotation @ poses[50].rotation)
    assert np.degrees(np.linalg.norm(error)) < 0.15


def test_wheels_determine_the_scale(motion):
    rng = np.random.default_rng(0)
    times, poses = seen(motion)
    samples = np.arange(0, 12.0, 0.02)
    speed = np.linalg.norm(motion.kinematics(samples).velocity, axis=1) + 0.02 * rng.normal(size=len(samples))
    centers = np.array([pose.translation for pose in poses])
    found = scale_from_wheels(times, centers, WheelSpeeds(samples, speed))
    assert found.metres == pytest.approx(METRES_PER_UNIT, rel=3 * found.relative_sigma)
    assert 0.009 < found.relative_sigma < 0.02
    assert "use the same clock" in scale_from_wheels(times + 1e5, centers, WheelSpeeds(samples, speed)).reason
    assert "the wheels moved in" in scale_from_wheels(times, centers, WheelSpeeds(samples, 0 * speed)).reason


@pytest.mark.parametrize(("unit", "expected"), [("m", False), ("squares", True)])
def test_a_rig_without_metres_takes_the_scale_of_another_source(unit, expected):
    rig = SimpleNamespace(unit=unit)
    tracking = SimpleNamespace(has_scale=True, rig=rig, trajectory=(), lost=(), extrapolated_from=None)
    known = SimpleNamespace(apply=lambda poses, lost, loops: "in metres", correct=lambda before, after: None)
    assert (_in_metres(tracking, LoopClosure(()), known) == "in metres") == expected


def test_speeds_and_images_of_one_per_second_determine_the_scale(motion):
    times, poses = seen(motion)
    centers = np.array([pose.translation for pose in poses])
    samples = np.arange(0, 12.01, 1.0)
    wheels = WheelSpeeds(samples, np.linalg.norm(motion.kinematics(samples).velocity, axis=1))
    # Positions of a curve are nearer than the distance driven, and the speed between two samples is not known.
    assert scale_from_wheels(times, centers, wheels).metres == pytest.approx(METRES_PER_UNIT, rel=0.1)
    assert scale_from_wheels(times[::10], centers[::10], wheels).metres == pytest.approx(METRES_PER_UNIT, rel=0.1)
    slow = WheelSpeeds(samples[::3], wheels.speed[::3])
    assert "the speeds 3.0 s: at most 2.5 s" in scale_from_wheels(times, centers, slow).reason


def ground(rng, height, walls=60, floor=60):
    """Return points of a floor below a camera, and of walls around."""
    angle = rng.uniform(0, 2 * np.pi, floor + walls)
    radius = np.concatenate([rng.uniform(0.5, 3, floor), np.full(walls, 4.0)]) * height
    depth = np.concatenate([np.full(floor, height), rng.uniform(-2, 1, walls) * height])
    points = np.stack([radius * np.cos(angle), depth, radius * np.sin(angle)], -1)
    return points * (1 + 0.01 * rng.normal(size=(len(points), 1)))


def test_the_height_is_that_of_the_plane_below_a_tilted_camera():
    rng = np.random.default_rng(0)
    heights = []
    for frame in range(40):
        pose = Pose(so3.exp(rng.normal(0, 0.08, 3)), np.zeros(3))
        heights.append(ground_height(frame, ground(rng, 0.6), pose, DOWN))
    assert all(found is not None and abs(found.height - 0.6) < 0.03 for found in heights)
    found = scale_from_height(heights, 1.5)
    assert found.metres == pytest.approx(METRES_PER_UNIT, rel=max(4 * found.relative_sigma, 0.01))


def test_without_ground_the_height_is_unknown():
    rng = np.random.default_rng(0)
    assert ground_height(0, ground(rng, 0.6, floor=3), Pose(), DOWN) is None
    assert ground_height(0, np.zeros((0, 3)), Pose(), DOWN) is None
    assert "too few points on it" in scale_from_height([], 1.5).reason


def test_a_robust_mean_ignores_outliers_and_states_its_uncertainty():
    rng = np.random.default_rng(0)
    ratios = []
    for _ in range(200):
        values = 5 + 0.1 * rng.normal(size=30)
        values[:3] += 4
        mean, sigma = robust_mean(values)
        ratios.append((mean - 5) / sigma)
    assert 0.7 < np.std(ratios) < 1.5
    assert abs(np.mean(ratios)) < 0.6


def tracked(motion):
    times, poses = seen(motion)
    return [TrackedPose(k, t, pose.inverse()) for k, (t, pose) in enumerate(zip(times, poses, strict=True))]


def sources(**known):
    nothing = {"height": None, "down": (0.0, 1.0, 0.0), "wheels": None, "imu": None, "distance": None}
    return ScaleSources(**{**nothing, **known})


def test_segments_have_scales_of_their_own_and_follow_each_other(motion):
    poses = tracked(motion)
    later = [
        dataclasses.replace(
            pose, rig_from_world=Pose(pose.rig_from_world.rotation, 3 * pose.rig_from_world.translation)
        )
        for pose in poses[60:]
    ]
    lost = [LostSegment(60, 60, "a cut", "new segment")]
    found = sources(imu=inertial(motion)).apply([*poses[:60], *later], lost)
    assert found.scale
    assert not found.warnings
    centers = np.array([pose.rig_from_world.inverse().translation for pose in found.poses])
    true = motion.kinematics(np.array([pose.seconds for pose in poses])).position
    for part in (slice(0, 60), slice(60, 119)):
        lengths = [np.linalg.norm(np.ptp(rows[part], axis=0)) for rows in (centers, true)]
        assert lengths[0] == pytest.approx(lengths[1], rel=0.12)


def test_segments_that_a_loop_joins_keep_their_relative_poses(motion):
    poses = tracked(motion)
    lost = [LostSegment(60, 60, "a cut", "new segment")]
    loop = Loop(3, 90, Pose(), 1.0, 40, 30, 0.8)
    joined = sources(imu=inertial(motion)).apply(poses, lost, [loop])
    assert joined.scale
    ratios = {
        np.linalg.norm(_step(joined.poses, a, b)) / np.linalg.norm(_step(poses, a, b))
        for a, b in ((0, 40), (10, 100), (50, 70), (70, 110))
    }
    assert max(ratios) == pytest.approx(min(ratios), rel=1e-9)
    assert min(ratios) == pytest.approx(joined.scale.metres, rel=1e-9)


def _step(poses, a, b):
    return poses[b].rig_from_world.inverse().translation - poses[a].rig_from_world.inverse().translation


def test_the_uncertainty_of_a_measured_height_is_part_of_the_scale():
    same = [GroundHeight(k, 2.0, 100) for k in range(400)]
    assert scale_from_height(same, 0.5).relative_sigma >= 0.015


def test_scales_that_contradict_each_other_are_reported(motion):
    poses = tracked(motion)
    true = motion.kinematics(np.array([0.0, 4.0])).position
    length = float(np.linalg.norm(true[1] - true[0]))
    right = sources(imu=inertial(motion), distance=(0, 40, length)).apply(poses, [])
    assert right.scale
    assert not right.warnings
    wrong = sources(imu=inertial(motion), distance=(0, 40, 1.6 * length)).apply(poses, [])
    assert "one of them is wrong" in wrong.warnings[0]
    missing = sources(distance=(0, 4000, 1.0)).apply(poses, [])
    assert not missing.scale
    assert "image 4000 has no pose" in missing.scale.reason


def test_tables_of_sensors_are_read_in_seconds_and_nanoseconds(tmp_path):
    path = tmp_path / "imu.csv"
    path.write_text("#timestamp [ns],w,w,w,a,a,a\n0,1,2,3,4,5,6\n5000000,1,2,3,4,5,6\n")
    imu = read_imu(path)
    assert np.allclose(imu.times, [0, 0.005])
    assert np.allclose(imu.specific_force, [[4, 5, 6]] * 2)
    path.write_text("time,speed,yaw\n10.0,1.5,0\n10.1,1.6,0\n")
    wheels = read_wheels(path)
    assert wheels.distance(np.array([10.0, 10.1])) == pytest.approx([0, 0.155])
    path.write_text("0,1.5\n0.1,fast\n")
    with pytest.raises(ValueError, match=r"line 2: expected time, speed"):
        read_wheels(path)
    path.write_text("#timestamp [ns],latitude,longitude,altitude\n0,47.37,8.54,406\n200000000,47.37,8.54,408\n")
    with pytest.raises(ValueError, match=r"line 2: expected time, speed \(m/s\), got '0,47.37,8.54,406'"):
        read_wheels(path)
    path.write_text("0,1.5\n0,1.5\n")
    with pytest.raises(ValueError, match="is not after the one before"):
        read_wheels(path)
    path.write_text("0,1.5\n")
    with pytest.raises(ValueError, match="has 1 samples"):
        read_wheels(path)


def test_options_of_the_scale_are_checked(tmp_path):
    with pytest.raises(ValueError, match="has no unit"):
        ScaleSources.of(om.OdometryOptions(height="1.2"))
    with pytest.raises(FileNotFoundError):
        ScaleSources.of(om.OdometryOptions(wheels=tmp_path / "none.csv"))
