"""Uncertainty of the edges of the pose graph, by Monte Carlo of tracks whose errors are correlated."""

from dataclasses import dataclass

import numpy as np
import pytest

import omnisight as om
from omnisight.visual_odometry.loop_graph import odometry_edges, point_information
from omnisight.visual_odometry.ray_observations import FrameRays

KEYFRAMES, POINTS, SIGMA = 12, 400, 1e-3
# Correlation of the errors of rays of a track: measured in rendered sequences, see docs/guide/odometry.md.
CORRELATION = 0.6


@dataclass
class Drive:
    """Keyframes along a line with rays of the same points, with the interface of `KeyframeHistory`."""

    poses: list
    points: np.ndarray
    bearings: np.ndarray
    axes: np.ndarray
    noise: list

    def __len__(self):
        return len(self.poses)

    @property
    def segments(self):
        return [0] * len(self)

    def rays(self, row):
        return FrameRays(
            np.arange(len(self.points)), self.points, np.zeros_like(self.points), self.bearings[row], self.axes[row]
        )


def drive(sigma=SIGMA, noise=1.0, seed=0):
    """Return a drive with errors of rays, for which SIGMA is assumed, and the errors (P, 3) of its points."""
    rng = np.random.default_rng(seed)
    poses = [om.Pose(np.eye(3), np.array([0.0, 0.0, -float(k)])) for k in range(KEYFRAMES)]
    true = rng.normal(size=(POINTS, 3)) * np.array([8.0, 8.0, 8.0]) + np.array([0.0, 0.0, KEYFRAMES / 2])
    offsets = np.array([pose @ true for pose in poses])
    distance = np.linalg.norm(offsets, axis=2, keepdims=True)
    bearings = offsets / distance
    first = np.cross(bearings, [0.0, 1.0, 0.0])
    first /= np.linalg.norm(first, axis=2, keepdims=True)
    axes = np.stack([first, np.cross(bearings, first)], axis=2) / SIGMA
    common, own = rng.normal(size=(1, POINTS, 2)), rng.normal(size=(KEYFRAMES, POINTS, 2))
    errors = sigma / SIGMA * (np.sqrt(CORRELATION) * common + np.sqrt(1 - CORRELATION) * own)
    measured = bearings + SIGMA**2 * np.einsum("knij,kni->knj", axes, errors)
    measured /= np.linalg.norm(measured, axis=2, keepdims=True)
    # The linear least squares of all rays.
    by_point = axes / distance[..., None]
    information = np.einsum("knij,knil->njl", by_point, by_point)
    right = np.einsum("knij,kni->nj", by_point, errors)
    step = np.linalg.solve(information, right[..., None])[..., 0]
    return Drive(poses, true + step, measured, axes, [noise] * KEYFRAMES), step


def test_the_covariance_of_points_is_true_for_tracks_with_correlated_errors():
    found, errors = drive()
    squares = np.einsum("ni,nij,nj->n", errors, point_information(found), errors)
    assert 0.5 < squares.mean() / 3 < 1.2


def test_the_covariance_of_points_follows_the_noise_of_the_rays():
    found, errors = drive(sigma=3 * SIGMA, noise=3.0)
    squares = np.einsum("ni,nij,nj->n", errors, point_information(found), errors)
    assert 0.5 < squares.mean() / 3 < 1.2


def test_more_keyframes_hardly_improve_an_edge_of_tracks_with_a_common_error():
    """Six times the rays of independent errors would divide the variance by six."""
    found, _ = drive()
    short = Drive(found.poses[:2], found.points, found.bearings[:2], found.axes[:2], found.noise[:2])
    turn = [
        np.linalg.inv(edges.root[0].T @ edges.root[0])[:3, :3].trace() for edges in map(odometry_edges, (found, short))
    ]
    assert turn[0] == pytest.approx(turn[1], rel=0.35)
