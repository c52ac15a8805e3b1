"""Refined poses of the cameras on a rig: their covariance, and how far they are from those of the file."""

from dataclasses import replace
from itertools import combinations

import numpy as np

import omnisight as om
from omnisight.geometry.pose import Pose
from omnisight.pipeline.reconstruction.reconstruction_result import ReconstructionResult
from omnisight.sfm.common_extrinsics import with_common_extrinsics
from omnisight.sfm.mapping import map_images
from omnisight.sfm.result import build_reconstruction
from omnisight.sfm.rig_images import RigImages
from omnisight.sfm.view_graph import match_pairs
from sfm.worlds import circle_of_poses, observe, points_around, sensors_apart

SIGMA_DEG = 0.05
SENSORS = sensors_apart(3)
SEEDS = range(20)


def place(seed):
    """Return keypoints of a rig of three cameras in one place, with noise, and their sensors and frames."""
    frames = circle_of_poses(4)
    sensor, frame = np.divmod(np.arange(len(SENSORS) * len(frames)), len(frames))
    poses = [SENSORS[s] @ frames[f] for s, f in zip(sensor, frame, strict=True)]
    return observe(poses, points_around(60), SIGMA_DEG, seed), sensor, frame


def maps_of(*places):
    """Return the keypoints, and the maps of places without common points, in which the poses of the rig are refined."""
    keypoints = [each for of_place, _, _ in places for each in of_place]
    sensor = np.concatenate([sensors for _, sensors, _ in places])
    frame = np.concatenate([frames + 4 * k for k, (_, _, frames) in enumerate(places)])
    matrices = np.array([pose.matrix for pose in SENSORS])
    images = RigImages.of(keypoints, sensor, 3).on_rig(frame, matrices, is_known=True)
    size = len(places[0][0])
    pairs = [pair for pair in combinations(range(len(keypoints)), 2) if pair[0] // size == pair[1] // size]
    graph = match_pairs(keypoints, pairs, lambda *_: None, images.known_pose)
    return keypoints, map_images(keypoints, images, graph, lambda *_: None, refines_sensors=True)


def model_of(found, keypoints):
    """Return the model of a map."""
    rig = om.Rig((om.sphere(100),) * 3, (Pose(),) * 3, ("front", "left", "right"))
    names, colors = [f"{k}.jpg" for k in range(len(keypoints))], [np.zeros((len(k), 3), np.uint8) for k in keypoints]
    return build_reconstruction(found, rig, names, keypoints, colors)


def refined(seed):
    """Return the model of one place."""
    keypoints, (found,) = maps_of(place(seed))
    return model_of(found, keypoints)


def normalized_square(rig):
    """Return the squared error of the poses of a rig over their covariance, per degree of freedom."""
    steps = [true.step_to(pose) for true, pose in zip(SENSORS, rig.sensor_from_rig, strict=True)]
    assert not rig.covariance[:6].any()  # the first camera defines the frame of the rig
    # The largest coordinate of a translation defines the scale: it has no covariance.
    free = np.flatnonzero(np.diagonal(rig.covariance) > 1e-20)
    assert len(free) == 11
    error = np.concatenate(steps)[free]
    return error @ np.linalg.solve(rig.covariance[np.ix_(free, free)], error) / len(free)


def test_covariance_of_refined_poses_is_that_of_their_errors():
    squares = [normalized_square(refined(seed).rig) for seed in SEEDS]
    assert 0.8 < np.mean(squares) < 1.25


def test_maps_of_several_places_have_one_rig_that_is_more_accurate_than_that_of_each():
    squares, ratios = [], []
    for seed in range(8):
        keypoints, maps = maps_of(place(seed), place(100 + seed))
        assert len(maps) == 2
        single = model_of(maps[0], keypoints).rig
        common = with_common_extrinsics(maps)
        assert all(a.noise.sigma < 1.1 * b.noise.sigma for a, b in zip(common, maps, strict=True))
        models = [model_of(found, keypoints) for found in common]
        assert models[0].rig == models[1].rig
        squares.append(normalized_square(models[0].rig))
        ratios.append(np.trace(models[0].rig.covariance) / np.trace(single.covariance))
    assert 0.6 < np.mean(squares) < 1.4
    assert 0.4 < np.median(ratios) < 0.8


def test_changes_of_the_poses_are_stated_for_cameras_with_images():
    model = refined(0)
    known = (SENSORS[0], SENSORS[1].moved([0.01, 0, 0, 0, 0.02, 0]), SENSORS[2])
    result = ReconstructionResult((model,), len(model), {}, (), 0.0, known_poses=known)
    left, right = result.extrinsics_changes
    assert (left.camera, right.camera) == ("left", "right")
    assert abs(left.angle - 0.01) < 4 * left.angle_sigma
    assert abs(left.distance - 0.02) < 4 * left.distance_sigma
    assert right.distance < 4 * right.distance_sigma
    only_front = replace(model, sensor=np.zeros_like(model.sensor))
    assert replace(result, models=(only_front,)).extrinsics_changes == ()
    assert replace(result, known_poses=()).extrinsics_changes == ()
