import numpy as np
from benchmarks.sfm_score import pose_errors

from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import exp
from sfm.worlds import circle_of_poses

TRUE = [pose.inverse() for pose in circle_of_poses(12)]


def in_another_world(poses):
    turn = exp([0.3, -1.0, 0.5])
    return [Pose(turn @ pose.rotation, 2.5 * turn @ pose.translation + np.arange(3)) for pose in poses]


def test_a_similarity_is_no_error():
    errors = pose_errors(in_another_world(TRUE), TRUE, length=12.0)
    assert errors.correct == 12
    assert errors.position < 1e-9
    assert errors.rotation_deg < 1e-6


def test_frames_in_a_wrong_place_do_not_change_the_errors_of_the_others():
    moved = [Pose(exp([0, 0.1, 0]) @ pose.rotation, pose.translation + np.array([3.0, 0.0, 1.0])) for pose in TRUE[:4]]
    errors = pose_errors(in_another_world([*moved, *TRUE[4:]]), TRUE, length=12.0)
    assert errors.correct == 8
    assert errors.position < 1e-9
    assert errors.rotation_deg < 1e-6


def test_two_poses_have_no_errors():
    errors = pose_errors(TRUE[:2], TRUE[:2], length=1.0)
    assert errors.correct == 0
    assert np.isnan(errors.position)
    assert np.isnan(errors.rotation_deg)
