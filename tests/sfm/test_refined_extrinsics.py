"""Refined poses of the cameras on a rig: their covariance, and how far they are from those of the file."""

from dataclasses import replace
from itertools import combinations

import numpy as np

import omnisight as om
from omnisight.geometry.pose import Pose
from omnisight.pipeline.reconstruction.reconstruction_result import ReconstructionResult
from omnisight.sfm.mapping import map_images
from omnisight.sfm.result import build_reconstruction
from omnisight.sfm.rig_images import RigImages
from omnisight.sfm.view_graph import match_pairs
from sfm.worlds import circle_of_poses, observe, points_around, sensors_apart

SIGMA_DEG = 0.05
SENSORS = sensors_apart(3)
SEEDS = range(30)


def refined(seed):
    """Return the model of a rig of three cameras whose poses are refined, from images with noise."""
    frames, matrices = circle_of_poses(4), np.array([pose.matrix for pose in SENSORS])
    sensor, frame = np.divmod(np.arange(len(SENSORS) * len(frames)), len(frames))
    poses = [SENSORS[s] @ frames[f] for s, f in zip(sensor, frame, strict=True)]
    keypoints = observe(poses, points_around(60), SIGMA_DEG, seed)
    images = RigImages.of(keypoints, sensor, 3).on_rig(frame, matrices, is_known=True)
    graph = match_pairs(keypoints, list(combinations(range(len(keypoints)), 2)), lambda *_: None, images.known_pose)
    (found,) = map_images(keypoints, images, graph, lambda *_: None, refines_sensors=True)
    rig = om.Rig((om.sphere(100),) * 3, (Pose(),) * 3, ("front", "left", "right"))
    names, colors = [f"{k}.jpg" for k in range(len(keypoints))], [np.zeros((len(k), 3), np.uint8) for k in keypoints]
    return build_reconstruction(found, rig, names, keypoints, colors)


def test_covariance_of_refined_poses_is_that_of_their_errors():
    squares = []
    for seed in SEEDS:
        rig = refined(seed).rig
        steps = [true.step_to(pose) for true, pose in zip(SENSORS, rig.sensor_from_rig, strict=True)]
        assert not rig.covariance[:6].any()  # the first camera defines the frame of the rig
        # The largest coordinate of a translation defines the scale: it has no covariance.
        free = np.flatnonzero(np.diagonal(rig.covariance) > 0)
        assert len(free) == 11
        error = np.concatenate(steps)[free]
        squares.append(error @ np.linalg.solve(rig.covariance[np.ix_(free, free)], error) / len(free))
    assert 0.8 < np.mean(squares) < 1.25


def test_changes_of_the_poses_are_stated_for_cameras_with_images():
    model = refined(0)
    known = (SENSORS[0], SENSORS[1].moved([0.01, 0, 0, 0, 0.02, 0]), SENSORS[2])
    result = ReconstructionResult((model,), len(model), {}, (), 0.0, known_poses=known)
    left, right = result.extrinsics_changes(model)
    assert (left.camera, right.camera) == ("left", "right")
    assert abs(left.angle - 0.01) < 4 * left.angle_sigma
    assert abs(left.distance - 0.02) < 4 * left.distance_sigma
    assert right.distance < 4 * right.distance_sigma
    only_front = replace(model, sensor=np.zeros_like(model.sensor))
    assert result.extrinsics_changes(only_front) == ()
    assert replace(result, known_poses=()).extrinsics_changes(model) == ()
