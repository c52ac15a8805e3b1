"""Poses of frames that agree, or not, with the noise of the frames before."""

import numpy as np
import pytest

from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import exp
from omnisight.visual_odometry.frame import Frame
from omnisight.visual_odometry.frame_locator import FrameLocator
from omnisight.visual_odometry.ray_observations import FrameRays

SIGMA_RAD = 1e-3
COUNT = 120
POSE = Pose(exp(np.array([0.02, -0.01, 0.03])), np.array([0.1, -0.05, 0.2]))


def frame(noise, seed, wrong=0):
    """Return a frame at POSE whose rays have a noise, of which some see other points."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(COUNT, 3))
    points *= rng.uniform(2, 20, (COUNT, 1)) / np.linalg.norm(points, axis=1, keepdims=True)
    bearings = POSE @ points
    bearings /= np.linalg.norm(bearings, axis=1, keepdims=True)
    first = np.cross(bearings, rng.normal(size=(COUNT, 3)))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    axes = np.stack([first, np.cross(bearings, first)], axis=1)
    sigma = np.where(np.arange(COUNT) < wrong, 0.05, noise * SIGMA_RAD)[:, None]
    bearings += np.einsum("nk,nkj->nj", sigma * rng.normal(size=(COUNT, 2)), axes)
    bearings /= np.linalg.norm(bearings, axis=1, keepdims=True)
    rays = FrameRays(np.arange(COUNT), points, np.zeros((COUNT, 3)), bearings, axes / SIGMA_RAD)
    return Frame(0, 0.0, (), Pose(), rays)


@pytest.fixture
def locator():
    """Return a locator after six frames of noise 1."""
    located = FrameLocator(0)
    for seed in range(6):
        found = located.locate(frame(1.0, seed), is_lost=False)
        assert found
        located.accept(found)
    return located


def test_the_noise_of_a_frame_may_grow_by_less_than_half(locator):
    found = locator.locate(frame(1.4, 9), is_lost=False)
    assert found.sigma == pytest.approx(1.4, rel=0.15)
    assert locator.locate(frame(1.4, 9), is_lost=True)


def test_a_pose_that_agrees_only_with_a_larger_noise_is_refused(locator):
    found = locator.locate(frame(12.0, 9), is_lost=False)
    assert not found
    assert "within the noise of the images before" in found.reason
    locator.restart()
    assert locator.locate(frame(12.0, 9), is_lost=False).sigma == pytest.approx(12, rel=0.15)


@pytest.mark.parametrize(("wrong", "is_found"), [(40, True), (80, False)])
def test_after_a_loss_most_points_must_agree(locator, wrong, is_found):
    found = locator.locate(frame(1.0, 9, wrong), is_lost=True)
    assert bool(found) == is_found
    if is_found:
        assert np.allclose(found.rig_from_world.matrix, POSE.matrix, atol=5e-3)
