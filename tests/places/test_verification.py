"""Verification of places: one scene seen twice, and scenes with one equal wall."""

import numpy as np
import pytest

import omnisight as om
from omnisight.features import Keypoints
from omnisight.geometry import rotation as so3
from omnisight.places.verification import agreeing_directions, even_directions

SIGMA = 5e-4


def scene(rng, count=400):
    """Return points around the origin and their descriptors."""
    bearings = rng.normal(size=(count, 3))
    bearings /= np.linalg.norm(bearings, axis=1, keepdims=True)
    looks = np.sqrt(rng.dirichlet(np.full(128, 0.5), count)).astype(np.float32)
    return bearings * rng.uniform(4, 8, (count, 1)), looks


def seen(points, looks, pose, rng):
    """Return the keypoints of a camera at a pose cam_from_world."""
    at = pose @ points
    bearings = at / np.linalg.norm(at, axis=1, keepdims=True) + SIGMA * rng.normal(size=at.shape)
    bearings /= np.linalg.norm(bearings, axis=1, keepdims=True)
    covariance = SIGMA**2 * (np.eye(3) - bearings[:, :, None] * bearings[:, None, :])
    return Keypoints(bearings[:, :2], bearings, covariance, np.zeros(len(at)), looks)


MOVED = om.Pose(so3.exp([0.1, 2.5, 0.0]), np.array([0.5, 0.1, -0.3]))


def test_a_place_seen_from_another_heading_agrees_in_all_directions():
    rng = np.random.default_rng(0)
    points, looks = scene(rng)
    match = om.verify_place(seen(points, looks, om.Pose(), rng), seen(points, looks, MOVED, rng))
    assert match.matches == pytest.approx(400, abs=5)
    assert match.inliers > 380
    assert match.directions > 0.95


def test_places_with_one_equal_wall_agree_in_its_direction_only():
    rng = np.random.default_rng(1)
    points, looks = scene(rng)
    others, other_looks = scene(rng)
    wall = points[:, 2] > 0.8 * np.linalg.norm(points, axis=1)
    others[wall], other_looks[wall] = points[wall], looks[wall]
    match = om.verify_place(seen(points, looks, om.Pose(), rng), seen(others, other_looks, MOVED, rng))
    assert match.inliers > 0.9 * wall.sum() > 30
    assert match.directions < 0.35


def test_unrelated_images_do_not_match():
    rng = np.random.default_rng(2)
    match = om.verify_place(*(seen(*scene(rng), om.Pose(), rng) for _ in range(2)))
    assert match.inliers == 0
    assert match.directions == 0.0


def test_directions_without_keypoints_do_not_count():
    rng = np.random.default_rng(3)
    ahead = even_directions(24)[:3].repeat(10, axis=0) + 0.01 * rng.normal(size=(30, 3))
    assert agreeing_directions(ahead, ahead[:10]) == pytest.approx(1 / 3)
    assert agreeing_directions(ahead[:0], ahead[:0]) == 0.0
