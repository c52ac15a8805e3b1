"""Closing of loops in a corridor of random points, with drift that is known exactly."""

import numpy as np
import pytest

import omnisight as om
from omnisight.features import Keypoints
from omnisight.geometry import rotation as so3
from omnisight.sfm.georeference import least_squares_similarity
from omnisight.visual_odometry.frame_result import TrackedPose
from omnisight.visual_odometry.keyframe_history import KeyframePlace
from omnisight.visual_odometry.loop_closing import close_loops
from omnisight.visual_odometry.ray_observations import FrameRays

LAP, COUNT, RADIUS, SIGMA = 64, 84, 20.0, 2e-4
EVERY = 2  # frames per keyframe


class Corridor:
    """Keyframes along a round corridor, one lap and a quarter, with the interface of `KeyframeHistory`.

    The world of odometry drifts in heading and, without a scale, in scale. A second camera of a rig sees some of the
    same points.
    """

    def __init__(self, seed=0, turn_deg=3.0, scale=1.05, twin=False, baseline=0.0):
        self.second = np.array([baseline, 0.0, 0.0])
        rng = np.random.default_rng(seed)
        angle = np.linspace(0, 2 * np.pi, 700, endpoint=False) + rng.uniform(0, 0.01, 700)
        self.radius = RADIUS + rng.choice([-3.0, 3.0], 700)
        self.world = np.stack([self.radius * np.sin(angle), rng.uniform(-2, 2, 700), self.radius * np.cos(angle)], -1)
        self.angle = angle
        self.looks = np.sqrt(rng.dirichlet(np.full(128, 0.5), 700)).astype(np.float32)
        if twin:  # the outer wall of one quarter looks like that of another
            outer = self.radius > RADIUS
            here, there = (np.flatnonzero(outer & (np.abs(angle - at) < 0.35)) for at in (1.0, 3.5))
            count = min(len(here), len(there))
            self.world[there[:count]] = self.world[here[:count]] @ so3.exp([0, 2.5, 0]).T
            self.looks[there[:count]] = self.looks[here[:count]]
        share = np.arange(COUNT) / LAP
        self.true = [
            om.Pose(
                so3.exp([0, 2 * np.pi * s + np.pi / 2, 0]),
                RADIUS * np.array([np.sin(2 * np.pi * s), 0, np.cos(2 * np.pi * s)]),
            ).inverse()
            for s in share
        ]
        self.frames, self.segments, self.losses = list(range(0, EVERY * COUNT, EVERY)), [0] * COUNT, [0]
        self.noise = [1.0] * COUNT
        self.poses, drift = [self.true[0]], so3.exp(np.radians([0.3 * turn_deg, turn_deg, 0]) / COUNT)
        for k in range(1, COUNT):
            step = self.true[k] @ self.true[k - 1].inverse()
            moved = om.Pose(
                drift @ step.rotation, scale ** (k / COUNT) * (step.translation + 1e-3 * rng.normal(size=3))
            )
            self.poses.append(moved @ self.poses[-1])
        self.points = np.full((2 * len(self.world), 3), np.nan)
        self._rays = [self._rays_of(k, rng, scale ** (k / COUNT)) for k in range(COUNT)]
        self._places = [self._place_of(k, rng) for k in range(0, COUNT, 2)]

    def __len__(self):
        return COUNT

    def rays(self, row):
        number, bearings, origins = self._rays[row]
        axes = np.array([np.linalg.svd(b[None])[2][1:] for b in bearings]) / SIGMA
        return FrameRays(number, self.points[number], origins, bearings, axes)

    def places(self):
        return self._places

    def _seen(self, k, rng):
        at = self.true[k] @ self.world
        seen = np.flatnonzero(np.linalg.norm(at, axis=1) < 9)
        return seen, self._noisy(at[seen], rng), at[seen]

    @staticmethod
    def _noisy(at, rng):
        bearings = at / np.linalg.norm(at, axis=1)[:, None] + SIGMA * rng.normal(size=at.shape)
        return bearings / np.linalg.norm(bearings, axis=1)[:, None]

    def _rays_of(self, k, rng, scale):
        seen, bearings, at = self._seen(k, rng)
        # Patches of the second lap are others than those of the first.
        number = seen + len(self.world) * (k >= LAP - 4)
        new = np.isnan(self.points[number, 0])
        self.points[number[new]] = self.poses[k].inverse() @ (scale * at[new])
        origins = np.zeros_like(bearings)
        if self.second.any():
            again = self._noisy(at[::2] - self.second, rng)
            number, bearings = np.append(number, number[::2]), np.concatenate([bearings, again])
            origins = np.concatenate([origins, np.tile(self.second, (len(again), 1))])
        return number, bearings, origins

    def _place_of(self, k, rng):
        seen, bearings, _ = self._seen(k, rng)
        looks = self.looks[seen] + 0.01 * rng.normal(size=(len(seen), 128)).astype(np.float32)
        looks /= np.linalg.norm(looks, axis=1, keepdims=True)
        covariance = SIGMA**2 * (np.eye(3) - bearings[:, :, None] * bearings[:, None, :])
        keypoints = Keypoints(bearings[:, :2], bearings, covariance, np.zeros(len(seen)), looks)
        return KeyframePlace(k, keypoints, np.zeros_like(bearings))

    @property
    def trajectory(self):
        """Poses of all frames; those between keyframes are at their middle."""
        found = []
        for k in range(COUNT - 1):
            found.append(TrackedPose(EVERY * k, 0.1 * EVERY * k, self.poses[k]))
            step = self.poses[k + 1] @ self.poses[k].inverse()
            half = om.Pose(so3.exp(so3.log(step.rotation) / 2), step.translation / 2)
            found.append(TrackedPose(EVERY * k + 1, 0.1 * (EVERY * k + 1), half @ self.poses[k]))
        return found

    def error(self, trajectory):
        """Return the rms position error of the keyframes over the path length."""
        of_keyframes = [pose for pose in trajectory if pose.frame % EVERY == 0]
        found = np.array([pose.rig_from_world.inverse().translation for pose in of_keyframes])
        true = np.array([self.true[pose.frame // EVERY].inverse().translation for pose in of_keyframes])
        aligned = least_squares_similarity(found, true)
        length = np.linalg.norm(np.diff(true, axis=0), axis=1).sum()
        return np.sqrt(((aligned @ found - true) ** 2).sum(axis=1).mean()) / length


def test_closed_loops_remove_the_drift_of_position_heading_and_scale():
    corridor = Corridor()
    trajectory = corridor.trajectory
    closed = close_loops(corridor, trajectory, has_scale=False)
    assert closed
    assert not closed.rejected
    assert all(abs(loop.last - loop.first - EVERY * LAP) <= 8 for loop in closed.loops)
    assert [loop.scale for loop in closed.loops] == pytest.approx(
        [1 / 1.05 ** (LAP / COUNT)] * len(closed.loops), rel=0.02
    )
    before, after = corridor.error(trajectory), corridor.error(closed.trajectory)
    assert before > 0.002
    assert after < 0.0002
    assert closed.correction > 1.0


def test_with_a_scale_the_trajectory_stays_in_metres():
    corridor = Corridor(scale=1.0, baseline=0.5)
    closed = close_loops(corridor, corridor.trajectory, has_scale=True)
    assert closed
    assert {loop.scale for loop in closed.loops} == {1.0}
    assert corridor.error(closed.trajectory) < 0.0002
    found, true = (
        [p.inverse().translation for p in poses]
        for poses in (
            [pose.rig_from_world for pose in closed.trajectory if pose.frame % EVERY == 0],
            corridor.true[:-1],
        )
    )
    found, true = (np.linalg.norm(np.diff(each, axis=0), axis=1).sum() for each in (found, true))
    assert found == pytest.approx(true, rel=0.01)


def test_frames_between_keyframes_follow():
    corridor = Corridor()
    closed = close_loops(corridor, corridor.trajectory, has_scale=False)
    assert [pose.frame for pose in closed.trajectory] == [pose.frame for pose in corridor.trajectory]
    centers = np.array([pose.rig_from_world.inverse().translation for pose in closed.trajectory])
    steps = np.linalg.norm(np.diff(centers, axis=0), axis=1)
    assert steps.max() < 1.1 * np.median(steps)
    assert steps.min() > 0.9 * np.median(steps)


def test_without_a_second_visit_all_keyframes_are_refined_together():
    corridor = Corridor()
    corridor._places = corridor._places[: LAP // 4]
    trajectory = corridor.trajectory
    closed = close_loops(corridor, trajectory, has_scale=False)
    assert not closed
    assert closed.reason == "no place was seen again"
    connected = slice(EVERY * (LAP - 4))  # by patches of the first lap
    before, after = (corridor.error(each[connected]) for each in (trajectory, closed.trajectory))
    assert before > 0.001
    assert after < 0.0001


def test_a_wall_that_looks_like_another_one_closes_no_loop():
    corridor = Corridor(twin=True)
    closed = close_loops(corridor, corridor.trajectory, has_scale=False)
    assert closed
    assert all(abs(loop.last - loop.first - EVERY * LAP) <= 8 for loop in closed.loops)
    assert corridor.error(closed.trajectory) < 0.0005
