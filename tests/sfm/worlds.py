"""Synthetic worlds: keypoints of points all around cameras with known poses."""

import numpy as np

from omnisight.features import Keypoints
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import exp


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def circle_of_poses(count, radius=2.0, seed=0):
    """Return cam_from_world of cameras on a circle with random orientations; the first is the world."""
    rng = np.random.default_rng(seed)
    angles = 2 * np.pi * np.arange(count) / count
    centers = radius * np.column_stack([1 - np.cos(angles), 0.1 * np.sin(3 * angles), np.sin(angles)])
    rotations = [np.eye(3), *(exp(rng.normal(0, 1, 3)) for _ in range(count - 1))]
    return [Pose(r, -r @ c) for r, c in zip(rotations, centers, strict=True)]


def sensors_apart(count=2, radius=0.5, seed=20):
    """Return sensor_from_rig of sensors in different directions; the first is the rig's frame."""
    rng = np.random.default_rng(seed)
    others = [Pose(exp(rng.normal(0, 1, 3)), rng.normal(0, radius, 3)) for _ in range(count - 1)]
    return [Pose(), *others]


def points_around(count, seed=1):
    rng = np.random.default_rng(seed)
    return unit(rng.normal(size=(count, 3))) * rng.uniform(4, 10, (count, 1)) + (2, 0, 0)


def observe(poses, points, sigma_deg, seed=2):
    """Return the keypoints of all points in every camera; the descriptors of a point are the same."""
    rng = np.random.default_rng(seed)
    descriptors = unit(rng.normal(size=(len(points), 64))).astype(np.float32)
    sigma = np.radians(sigma_deg)
    found = []
    for pose in poses:
        bearings = unit(pose @ points)
        bearings = unit(bearings + rng.normal(0, sigma, bearings.shape))
        covariance = sigma**2 * (np.eye(3) - bearings[:, :, None] * bearings[:, None, :])
        order = rng.permutation(len(points))
        pixels = rng.uniform(0, 100, (len(points), 2))
        scale = np.full(len(points), 0.01)
        found.append(Keypoints(pixels, bearings[order], covariance[order], scale, descriptors[order]))
    return found


def similarity_errors(cam_from_world, truth):
    """Return the errors of the positions after a similarity (Umeyama 1991), and of the rotations, degrees."""
    centers = np.array([-pose[:, :3].T @ pose[:, 3] for pose in cam_from_world])
    true = np.array([pose.inverse().translation for pose in truth])
    a, b = centers - centers.mean(0), true - true.mean(0)
    u, s, vt = np.linalg.svd(b.T @ a)
    sign = np.diag([1.0, 1.0, np.linalg.det(u @ vt)])
    rotation, scale = u @ sign @ vt, (s * np.diag(sign)).sum() / (a**2).sum()
    turns = [
        np.linalg.norm(rotation @ pose[:, :3].T @ t.rotation - np.eye(3)) / np.sqrt(2)
        for pose, t in zip(cam_from_world, truth, strict=True)
    ]
    return np.linalg.norm(scale * a @ rotation.T - b, axis=1), np.degrees(turns)
