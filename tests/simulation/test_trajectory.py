"""Motions: what is between poses, and files in and out, hostile ones refused with the line that is wrong."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import omnisight as om
from omnisight.geometry.rotation import exp
from omnisight.simulation import trajectory as module
from omnisight.simulation.preset_motion import DRIVE, PRESETS, Route, preset_trajectory
from omnisight.simulation.trajectory import Trajectory, quaternion, read_trajectory, write_trajectory

FREE = ((-1.0, -0.5, -2.0), (1.0, 0.5, 2.0))


def some(count=7, seed=0):
    rng = np.random.default_rng(seed)
    poses = tuple(om.Pose(exp(rng.normal(0, 1.2, 3)), rng.normal(size=3)) for _ in range(count))
    return Trajectory(np.cumsum(rng.uniform(0.1, 1, count)), poses)


def test_interpolation_matches_scipy_slerp():
    motion = some()
    slerp = Slerp(motion.times, Rotation.from_matrix([pose.rotation for pose in motion.poses]))
    for time in np.linspace(motion.times[0], motion.times[-1], 50):
        pose = motion.at(time)
        np.testing.assert_allclose(pose.rotation, slerp(time).as_matrix(), atol=1e-12)
        places = np.array([p.translation for p in motion.poses])
        expected = [np.interp(time, motion.times, places[:, k]) for k in range(3)]
        np.testing.assert_allclose(pose.translation, expected, atol=1e-12)
    assert motion.at(-5.0) is motion.poses[0]
    assert motion.at(99.0) is motion.poses[-1]


def test_row_times_are_symmetric_about_the_middle_row():
    motion = some()
    rows = motion.row_poses(1.5, 101, 0.2)
    for i, time in ((0, 1.4), (50, 1.5), (100, 1.6)):
        np.testing.assert_allclose(rows[i].translation, motion.at(time).translation, atol=1e-12)


def test_file_round_trip(tmp_path):
    motion = some(40)
    write_trajectory(tmp_path / "poses.txt", motion)
    again = read_trajectory(tmp_path / "poses.txt")
    np.testing.assert_allclose(again.times, motion.times, atol=1e-6)
    for a, b in zip(again.poses, motion.poses, strict=True):
        np.testing.assert_allclose(a.rotation, b.rotation, atol=1e-8)
        np.testing.assert_allclose(a.translation, b.translation, atol=1e-8)


def test_times_closer_than_a_microsecond_round_trip(tmp_path):
    times = np.array((0.0, 1e-7, 2.5e-7))
    write_trajectory(tmp_path / "poses.txt", Trajectory(times, some(3).poses))
    np.testing.assert_array_equal(read_trajectory(tmp_path / "poses.txt").times, times)


def test_quaternions_match_scipy():
    for pose in some(30, seed=3).poses:
        expected = Rotation.from_matrix(pose.rotation).as_quat(canonical=True)
        np.testing.assert_allclose(quaternion(pose.rotation), expected, atol=1e-12)


@pytest.mark.parametrize(
    "text",
    [
        "1.5 1 2 3 0 0 0.6 0.8\n2.5 4 5 6 0 0 0 1\n",
        "# a comment\n\n1.5,1,2,3,0,0,0.6,0.8\n2.5,4,5,6,0,0,0,1",
        "timestamp,tx,ty,tz,qx,qy,qz,qw\n1.5,1,2,3,0,0,0.6,0.8\r\n2.5,4,5,6,0,0,0,1\r\n",
        "qw;qx;qy;qz;tx;ty;tz;timestamp;note\n.8;0;0;.6;1;2;3;1.5;a\n1;0;0;0;4;5;6;2.5;b\n",
        "#timestamp tx ty tz qw qx qy qz\n1.5 1 2 3 0.8 0 0 0.6\n2.5 4 5 6 1 0 0 0\n",
        "\ufefftimestamp,tx,ty,tz,qx,qy,qz,qw\n1.5,1,2,3,0,0,0.6,0.8\n2.5,4,5,6,0,0,0,1\n",  # as spreadsheets do
        "1.5\t1\t2\t3\t0\t0\t0.6\t0.8\r\n2.5\t4\t5\t6\t0\t0\t0\t1",
    ],
)
def test_tum_and_csv_columns_are_read_by_name(tmp_path, text):
    (tmp_path / "file").write_bytes(text.encode())
    motion = read_trajectory(tmp_path / "file")
    np.testing.assert_array_equal(motion.times, [1.5, 2.5])
    np.testing.assert_array_equal(motion.poses[0].translation, [1, 2, 3])
    expected = Rotation.from_quat([0, 0, 0.6, 0.8]).as_matrix()
    np.testing.assert_allclose(motion.poses[0].rotation, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "contains no poses; expected lines of timestamp tx"),
        ("# only\n", "contains no poses"),
        ("1 2 3\n", "line 1: 3 values; expected 8 numbers"),
        ("1 0 0 0 0 0 0 1\n2 0 x 0 0 0 0 1\n", "line 2: 'x' is not a number"),
        ("1 0 0 0 0 0 0 1\n2 1" + 50 * "0" + "e-50 0 0 0 0 0 1\n", "line 2: '10+' is not a number"),  # not cut short
        ("#timestamp, p_RS_R_x [m]\n1,4.6,-1.7,0.8,0.9,0.1,-0.3,0.06,-0.02\n", "line 2: 9 values; expected 8"),  # EuRoC
        ("1 nan 0 0 0 0 0 1\n", "line 1: nan is out of range"),
        ("inf 0 0 0 0 0 0 1\n", "line 1: inf is out of range"),
        ("1 1e30 0 0 0 0 0 1\n", r"line 1: 1e\+30 is out of range"),
        ("1 0 0 0 0 0 0 0\n", "line 1: the quaternion .* has length 0, not 1"),
        ("2 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 1\n", "line 2: the time 2 is not after 2: times must increase"),
        ("\x00\xff\x01 " * 100, "line 1"),
        ("__import__('os') 0 0 0 0 0 0 1\n", "is not a number"),
    ],
)
def test_invalid_files_are_rejected_with_the_line(tmp_path, text, message):
    (tmp_path / "file").write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=message) as refused:
        read_trajectory(tmp_path / "file")
    assert str(tmp_path / "file") in str(refused.value)
    assert len(str(refused.value)) < 400


def test_too_large_files_are_rejected(tmp_path, monkeypatch):
    write_trajectory(tmp_path / "file", some(30))
    monkeypatch.setattr(module, "MAX_POSES", 20)
    with pytest.raises(ValueError, match="more than 20 poses"):
        read_trajectory(tmp_path / "file")
    monkeypatch.setattr(module, "MAX_FILE_BYTES", 100)
    with pytest.raises(ValueError, match="too large for a trajectory"):
        read_trajectory(tmp_path / "file")


@pytest.mark.parametrize("name", PRESETS)
def test_preset_trajectory_stays_in_its_box(name):
    motion = preset_trajectory(name, FREE)
    places = np.array([pose.translation for pose in motion.poses])
    assert (places >= np.array(FREE[0]) - 1e-12).all()
    assert (places <= np.array(FREE[1]) + 1e-12).all()
    assert motion.times[0] == 0.0
    for pose in motion.poses[::20]:
        np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(pose.rotation) > 0


@pytest.mark.parametrize("name", ["loop", "line"])
def test_camera_looks_along_the_motion(name):
    motion = preset_trajectory(name, FREE)
    places = np.array([pose.translation for pose in motion.poses])
    way = np.diff(places, axis=0) * (1, 0, 1)
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    ahead = np.array([pose.rotation[:, 2] for pose in motion.poses])[:-1]
    assert ((way * ahead).sum(1) > 0.98).all()


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("free", [FREE, ((-1.2, -0.6, -6.0), (1.2, 0.6, 18.0)), ((-0.1, 0, -0.1), (0.1, 0, 0.1))])
def test_preset_motion_is_that_of_a_walking_person(name, free):
    motion = preset_trajectory(name, free)
    step = np.diff(motion.times)[:, None]
    places = np.array([pose.translation for pose in motion.poses])
    speed = np.diff(places, axis=0) / step
    ahead = np.array([pose.rotation[:, 2] for pose in motion.poses])
    turned = np.arccos(np.clip((ahead[1:] * ahead[:-1]).sum(1), -1, 1)) / step[:, 0]
    assert np.linalg.norm(speed, axis=1).max() <= 1.4 * 1.001
    assert np.degrees(turned).max() <= 45.5
    # Along and across the path, the limits may be reached at the same time.
    assert np.linalg.norm(np.diff(speed, axis=0) / step[1:], axis=1).max() < 0.7 * np.sqrt(2) * 1.05
    if name == "line":
        assert np.linalg.norm(speed[[0, -1]], axis=1).max() < 0.02


def test_long_motion_repeats_a_loop():
    once, long = preset_trajectory("loop", FREE), preset_trajectory("loop", FREE, 60.0)
    assert long.times[-1] >= 60
    period = once.times[-1]
    np.testing.assert_allclose(long.at(1.5 + 2 * period).translation, once.at(1.5).translation, atol=1e-9)


def test_loop_is_closed():
    motion = preset_trajectory("loop", FREE)
    np.testing.assert_allclose(motion.poses[0].translation, motion.poses[-1].translation, atol=1e-12)
    np.testing.assert_allclose(motion.poses[0].rotation, motion.poses[-1].rotation, atol=1e-12)


def block(duration=0.0):
    corners = ((0.0, 0.0, 0.0), (0.0, -2.0, 60.0), (80.0, -2.0, 60.0), (80.0, 0.0, 0.0))
    return preset_trajectory("loop", FREE, duration, Route(corners, 14.0, DRIVE))


def test_route_is_followed_within_its_pace():
    motion = block()
    places, step = np.array([pose.translation for pose in motion.poses]), float(np.diff(motion.times).mean())
    speed = np.diff(places, axis=0) / step
    assert 7.9 < np.linalg.norm(speed, axis=1).max() <= DRIVE.speed * 1.001
    assert np.linalg.norm(np.diff(speed, axis=0) / step, axis=1).max() < DRIVE.acceleration * np.sqrt(2) * 1.05
    assert 0.9 * 280 < np.linalg.norm(speed, axis=1).sum() * step < 280
    ahead = np.array([pose.rotation[:, 2] for pose in motion.poses[1:-1]])
    along = (places[2:] - places[:-2]) / np.linalg.norm(places[2:] - places[:-2], axis=1, keepdims=True)
    assert ((ahead * along).sum(1) > 0.9999).all()
    assert np.abs(ahead[:, 1]).max() > 0.03  # uphill and downhill
    np.testing.assert_allclose([pose.rotation[1, 0] for pose in motion.poses], 0, atol=1e-12)  # no roll


def test_acceleration_along_a_route_is_continuous():
    """Also from one round to the next; a piecewise linear acceleration changes little between the poses."""
    motion = block(duration=100.0)
    places, step = np.array([pose.translation for pose in motion.poses]), float(np.diff(motion.times).mean())
    acceleration = np.diff(places, 2, axis=0) / step**2
    assert np.linalg.norm(np.diff(acceleration, axis=0), axis=1).max() < 0.25
    assert np.linalg.norm(acceleration, axis=1).max() > 1


def test_invalid_trajectories_are_rejected():
    with pytest.raises(ValueError, match="unknown trajectory 'jump'; choose one of: line, loop"):
        preset_trajectory("jump", FREE)
    with pytest.raises(ValueError, match="a time for each pose, got 2 and 1"):
        Trajectory(np.array((0.0, 1.0)), (om.Pose(),))
    with pytest.raises(ValueError, match="must increase"):
        Trajectory(np.array((1.0, 1.0)), (om.Pose(), om.Pose()))
