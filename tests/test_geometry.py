import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from omnisight.formats.native import rig_from_json, rig_to_json
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import look
from omnisight.rig import Rig
from omnisight.views import fisheye

RNG = np.random.default_rng(5)
AXES = np.concatenate([np.eye(3), -np.eye(3), RNG.normal(size=(30, 3))])
AXES /= np.linalg.norm(AXES, axis=1, keepdims=True)
ANGLES = [0.0, 1e-12, 1e-9, 1e-7, 1e-4, 0.3, 1.0, np.pi / 2, 2.5, np.pi - 1e-3, np.pi - 1e-6, np.pi - 1e-9]


def pose(seed):
    rng = np.random.default_rng(seed)
    return Pose(Rotation.random(random_state=seed).as_matrix(), rng.normal(size=3))


def assert_same(a, b):
    np.testing.assert_allclose(a.rotation, b.rotation, atol=1e-14)
    np.testing.assert_allclose(a.translation, b.translation, atol=1e-14)


# -- rotations --------------------------------------------------------------------------------------------------


def test_hat_is_the_cross_product():
    a, b = RNG.normal(size=(2, 4, 5, 3))
    np.testing.assert_allclose((so3.hat(a) @ b[..., None])[..., 0], np.cross(a, b), atol=1e-15)


@pytest.mark.parametrize("angle", [*ANGLES, np.pi, 4.0, 100.0])
def test_exp_agrees_with_scipy(angle):
    expected = Rotation.from_rotvec(angle * AXES).as_matrix()
    np.testing.assert_allclose(so3.exp(angle * AXES), expected, atol=1e-14 * (1 + angle))


@pytest.mark.parametrize("angle", ANGLES)
def test_log_inverts_exp(angle):
    # A rotation matrix holds an angle near pi to about the root of its last digit.
    found = so3.log(so3.exp(angle * AXES))
    np.testing.assert_allclose(found, angle * AXES, rtol=1e-12, atol=1e-14 if angle < 3 else 1e-7)
    np.testing.assert_allclose(so3.exp(found), so3.exp(angle * AXES), atol=2e-14 if angle < 3 else 1e-7)


def test_log_of_a_half_turn_is_either_axis():
    found = so3.log(so3.exp(np.pi * AXES))
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), np.pi, atol=1e-7)
    np.testing.assert_allclose(np.abs((found * AXES).sum(1)), np.pi, atol=1e-7)


def test_log_agrees_with_scipy_for_any_leading_shape():
    rotations = Rotation.random(24, random_state=1)
    found = so3.log(rotations.as_matrix().reshape(2, 3, 4, 3, 3))
    np.testing.assert_allclose(found.reshape(-1, 3), rotations.as_rotvec(), atol=1e-13)
    assert so3.exp(np.zeros(3)).shape == (3, 3)
    assert so3.log(np.eye(3)).shape == (3,)
    assert so3.exp(np.zeros((0, 3))).shape == (0, 3, 3)


def test_nearest_returns_the_nearest_rotation():
    true = Rotation.random(20, random_state=2).as_matrix()
    noisy = true + 0.01 * RNG.normal(size=true.shape)
    found = so3.nearest(noisy)
    np.testing.assert_allclose(found @ np.swapaxes(found, -1, -2), np.broadcast_to(np.eye(3), true.shape), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(found), 1, atol=1e-14)
    distance = np.linalg.norm(found - noisy, axis=(1, 2))
    assert (distance <= np.linalg.norm(true - noisy, axis=(1, 2))).all()
    for step in 1e-3 * AXES:
        assert (distance <= np.linalg.norm(so3.exp(step) @ found - noisy, axis=(1, 2))).all()
    np.testing.assert_allclose(np.linalg.det(so3.nearest(-true)), 1, atol=1e-14)


# -- poses ------------------------------------------------------------------------------------------------------


def test_poses_compose():
    c_from_b, b_from_a = pose(1), pose(2)
    x_a = RNG.normal(size=(4, 5, 3))
    np.testing.assert_allclose((c_from_b @ b_from_a) @ x_a, c_from_b @ (b_from_a @ x_a), atol=1e-14)
    expected = x_a @ b_from_a.rotation.T + b_from_a.translation
    np.testing.assert_allclose(b_from_a @ x_a, expected, atol=1e-15)
    np.testing.assert_allclose(b_from_a @ [0, 0, 0], b_from_a.translation)


def test_poses_are_a_group():
    a, b, c = pose(1), pose(2), pose(3)
    assert_same((a @ b) @ c, a @ (b @ c))
    assert_same(a @ a.inverse(), Pose())
    assert_same(a.inverse() @ a, Pose())
    assert_same(a @ Pose(), a)
    assert_same((a @ b).inverse(), b.inverse() @ a.inverse())


def test_a_pose_moves_by_a_step():
    b_from_a, step = pose(4), np.array([0.1, -0.2, 0.05, 1.0, 2.0, -3.0])
    moved, x = b_from_a.moved(step), RNG.normal(size=3)
    expected = so3.exp(step[:3]) @ b_from_a.rotation @ x + b_from_a.translation + step[3:]
    np.testing.assert_allclose(moved @ x, expected, atol=1e-14)
    assert_same(b_from_a.moved(np.zeros(6)), b_from_a)


# -- view directions --------------------------------------------------------------------------------------------


def in_view(direction, *angles, **options):
    """Return a direction of the camera (x right, y down, z forward) in the frame of the view."""
    return look(*angles, **options) @ np.asarray(direction, float)


FORWARD, RIGHT, LEFT, UP, DOWN, BACK = [0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1]


@pytest.mark.parametrize(
    ("angles", "centre"),
    [
        ((0, 0, 0), FORWARD),
        ((90, 0, 0), RIGHT),
        ((-90, 0, 0), LEFT),
        ((180, 0, 0), BACK),
        ((0, 90, 0), UP),
        ((0, -90, 0), DOWN),
        ((90, 90, 0), UP),
        ((0, 0, 77), FORWARD),
    ],
)
def test_the_view_centre_is_the_viewing_direction(angles, centre):
    np.testing.assert_allclose(in_view(centre, *angles), FORWARD, atol=1e-15)


def test_positive_yaw_moves_the_image_left_and_positive_pitch_down():
    assert in_view(FORWARD, 5)[0] < 0
    assert in_view(FORWARD, 0, 5)[1] > 0


def test_clockwise_roll_turns_the_image_counterclockwise():
    # What was above is to the left of a head that leans to the right.
    np.testing.assert_allclose(in_view(UP, 0, 0, 90), LEFT, atol=1e-15)
    np.testing.assert_allclose(in_view(RIGHT, 0, 0, 90), UP, atol=1e-15)


def test_yaw_turns_about_the_vertical_of_the_world_at_any_pitch():
    for yaw in (0, 40, 200):
        assert in_view(UP, yaw, 30) @ in_view(UP, 0, 30) == pytest.approx(1)


def test_up_back_levels_a_camera_that_looks_down():
    # The image's middle is the nadir, the image's top is ahead.
    np.testing.assert_allclose(in_view(FORWARD, up="back"), DOWN, atol=1e-15)
    np.testing.assert_allclose(in_view(UP, up="back"), FORWARD, atol=1e-15)
    np.testing.assert_allclose(in_view(RIGHT, up="back"), RIGHT, atol=1e-15)
    np.testing.assert_allclose(in_view(FORWARD, 123, -90, up="back"), FORWARD, atol=1e-15)


def test_up_front_levels_a_camera_that_looks_up():
    # The image's middle is the zenith; seen from below, left and right change places.
    np.testing.assert_allclose(in_view(FORWARD, up="front"), UP, atol=1e-15)
    np.testing.assert_allclose(in_view(UP, up="front"), FORWARD, atol=1e-15)
    np.testing.assert_allclose(in_view(RIGHT, up="front"), LEFT, atol=1e-15)


@pytest.mark.parametrize("up", ["top", "back", "front"])
def test_only_flip_changes_handedness(up):
    assert np.linalg.det(look(20, 30, 40, up=up)) == pytest.approx(1)
    flipped = look(20, 30, 40, up=up, flip=True)
    assert np.linalg.det(flipped) == pytest.approx(-1)
    np.testing.assert_allclose(flipped @ flipped.T, np.eye(3), atol=1e-15)


def test_flip_exchanges_left_and_right():
    np.testing.assert_allclose(in_view(RIGHT, flip=True), LEFT, atol=1e-15)
    np.testing.assert_allclose(in_view(UP, flip=True), UP, atol=1e-15)


def test_an_unknown_up_is_rejected_with_the_names():
    with pytest.raises(ValueError, match="top, back, front, got 'left'"):
        look(up="left")


def test_poses_of_lists_are_those_of_arrays():
    quarter, shift = [[0, -1, 0], [1, 0, 0], [0, 0, 1]], [1, 2, 3]
    turned = Pose(quarter, shift)
    assert turned == Pose(np.array(quarter, float), np.array(shift, float))
    assert turned.inverse() @ (turned @ [4, 5, 6]) == pytest.approx([4, 5, 6])
    assert rig_from_json(rig_to_json(Rig.from_sensors({"a": (fisheye(64, 180), turned)}))).sensor_from_rig == (turned,)
