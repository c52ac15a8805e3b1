"""Poses of sensors from independent images, with wrong ones among them."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import minimize

from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import exp, log
from omnisight.sfm.extrinsics import _median, estimate_extrinsics

SENSOR_FROM_RIG = Pose(exp([0.1, 1.2, -0.3]), np.array([1.0, 2.0, 3.0]))
WRONG = Pose(exp(np.radians([20.0, 0.0, 0.0])), np.array([5.0, 0.0, 0.0]))


def estimated(times, wrong, seed):
    """Return the pose of the second sensor from a map of two sensors at some times, one of which is wrong."""
    rng = np.random.default_rng(seed)
    world = [Pose(exp(rng.normal(0, 1, 3)), rng.normal(0, 5, 3)) for _ in range(times)]
    noise = [Pose(exp(rng.normal(0, np.radians(0.1), 3)), rng.normal(0, 0.01, 3)) for _ in range(times)]
    if wrong is not None:
        noise[wrong] = WRONG
    other = [n @ SENSOR_FROM_RIG @ pose for n, pose in zip(noise, world, strict=True)]
    found = SimpleNamespace(
        images=SimpleNamespace(sensor=np.repeat([0, 1], times), sensor_from_rig=np.tile(np.eye(3, 4), (2, 1, 1))),
        frames=np.arange(2 * times),
        rig_from_world=np.array([pose.matrix for pose in [*world, *other]]),
    )
    poses, used = estimate_extrinsics(found, np.tile(np.arange(times), 2))
    assert used.tolist() == [0, times]
    return Pose.of_matrix(poses[1])


@pytest.mark.parametrize("times", [3, 4, 5, 10])
def test_one_wrong_time_does_not_move_a_sensor_wherever_it_is(times):
    for wrong in range(times):
        errors = [estimated(times, wrong, seed) for seed in range(10)]
        shifts = [np.linalg.norm(pose.translation - SENSOR_FROM_RIG.translation) for pose in errors]
        angles = [np.linalg.norm(log(pose.rotation @ SENSOR_FROM_RIG.rotation.T)) for pose in errors]
        # Three standard deviations of a sample; with rotations of 0.1 degrees about an axis 3.7 away.
        assert max(shifts) < 0.05
        assert np.degrees(max(angles)) < 0.5


def test_the_geometric_median_of_poses_minimizes_the_sum_of_distances():
    rng = np.random.default_rng(3)
    offsets = rng.normal(0, 1, (7, 3))
    found = _median([Pose(np.eye(3), offset) for offset in offsets]).translation

    def cost(x):
        return np.linalg.norm(offsets - x, axis=1).sum()

    best = minimize(cost, offsets.mean(0), method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12})
    assert found == pytest.approx(best.x, abs=1e-6)
    # At a corner of more than 120 degrees, the median of three samples is that corner.
    corner = np.array([[0.0, 0.0, 0.0], [1.0, 0.1, 0.0], [-1.0, 0.1, 0.0]])
    for order in ([0, 1, 2], [1, 0, 2], [2, 1, 0]):
        median = _median([Pose(np.eye(3), offset) for offset in corner[order]])
        assert np.linalg.norm(median.translation) < 1e-3
