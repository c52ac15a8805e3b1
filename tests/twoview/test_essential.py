"""The decomposition of essential matrices with the test of positive distances."""

import numpy as np
import pytest
from motions import general_motion
from numba import njit

from omnisight.geometry.rotation import hat
from omnisight.twoview._essential_kernel import poses_from_essential


@njit
def decompose(e, a, b):
    poses = np.empty((1, 3, 4))
    return poses[: poses_from_essential(e, a, b, poses)]


@pytest.mark.parametrize("factor", [1.0, -1.0, 1e-9, -1e9])
def test_the_pose_does_not_depend_on_scale_and_sign(factor):
    for seed in range(50):
        a, b, pose = general_motion(np.random.default_rng(seed), 6)
        (found,) = decompose(factor * hat(pose[:, 3]) @ pose[:, :3], a, b)
        np.testing.assert_allclose(found, pose, rtol=0, atol=1e-12)


def test_a_point_at_a_negative_distance_excludes_every_pose():
    a, b, pose = general_motion(np.random.default_rng(1), 6)
    e = hat(pose[:, 3]) @ pose[:, :3]
    assert len(decompose(e, a, b)) == 1
    b[2] = -b[2]
    assert len(decompose(e, a, b)) == 0


@pytest.mark.parametrize("e", [np.zeros((3, 3)), np.full((3, 3), np.nan), np.full((3, 3), np.inf), np.ones((3, 3))])
def test_a_matrix_without_translation_has_no_pose(e):
    a, b, _ = general_motion(np.random.default_rng(2), 6)
    assert len(decompose(e, a, b)) == 0
