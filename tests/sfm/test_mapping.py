from dataclasses import replace
from itertools import combinations

import numpy as np

from omnisight.features.keypoints import concatenate
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import exp
from omnisight.sfm.mapping import KeypointRays, map_images
from omnisight.sfm.tracks import build_tracks
from omnisight.sfm.view_graph import Edge, match_pairs, overlapping_pairs
from sfm.worlds import circle_of_poses, observe, points_around, similarity_errors


def ignore(*_):
    pass


def mapped(keypoints):
    edges = match_pairs(keypoints, list(combinations(range(len(keypoints)), 2)), ignore)
    return map_images(keypoints, KeypointRays.of(keypoints), edges, ignore)


def test_cameras_on_a_circle_are_mapped_with_points_and_noise():
    poses, points = circle_of_poses(8), points_around(150)
    (found,) = mapped(observe(poses, points, 0.1))
    positions, rotations = similarity_errors(found.cam_from_world, poses)
    assert found.images.tolist() == list(range(8))
    assert positions.max() < 0.01
    assert rotations.max() < 0.1
    assert len(found.points) > 145
    assert len(found.tracks.track) > 7.5 * len(found.points)
    assert 0.9 < found.noise.sigma < 1.1


def test_the_map_is_deterministic():
    keypoints = observe(circle_of_poses(5), points_around(80), 0.1)
    (a,), (b,) = mapped(keypoints), mapped(keypoints)
    assert np.array_equal(a.cam_from_world, b.cam_from_world)
    assert np.array_equal(a.points, b.points)


def test_two_places_give_two_maps():
    here, there = (
        observe(circle_of_poses(5), points_around(100), 0.1),
        observe(circle_of_poses(4), points_around(100, seed=8), 0.1, seed=9),
    )
    maps = mapped([*here, *there])
    assert [found.images.tolist() for found in maps] == [[0, 1, 2, 3, 4], [5, 6, 7, 8]]


def test_images_of_one_place_have_orientations_and_no_points():
    rng = np.random.default_rng(4)
    poses = [Pose(), *(Pose(exp(rng.normal(0, 1, 3))) for _ in range(4))]
    (found,) = mapped(observe(poses, points_around(100), 0.05))
    assert len(found.points) == 0
    assert not found.cam_from_world[:, :, 3].any()
    true = np.array([pose.rotation for pose in poses])
    np.testing.assert_allclose(found.cam_from_world[:, :, :3], true, atol=2e-3)


def test_wrong_matches_are_not_observations():
    """A third of the keypoints of each image show other points than those that their descriptors belong to."""
    poses, points = circle_of_poses(6), points_around(150)
    right = observe(poses, points, 0.1)
    wrong = observe(
        circle_of_poses(6, seed=11), points_around(75, seed=12)[np.random.default_rng(0).permutation(75)], 0.1
    )
    keypoints = [concatenate([a, b]) for a, b in zip(right, wrong, strict=True)]
    maps = mapped(keypoints)
    positions, _ = similarity_errors(maps[0].cam_from_world, poses)
    assert positions.max() < 0.02


def test_pairs_without_common_features_are_not_selected():
    here, there = (
        observe(circle_of_poses(2), points_around(60), 0.1),
        observe(circle_of_poses(2), points_around(60), 0.1, seed=9),
    )
    pairs = list(combinations(range(4), 2))
    assert overlapping_pairs([*here, *there], pairs, ignore) == [(0, 1), (2, 3)]


def test_tracks_join_matches_of_several_images():
    def edge(a, b, *pairs):
        return Edge(a, b, None, np.array(pairs))

    tracks = build_tracks([edge(0, 1, (5, 1), (6, 2)), edge(1, 2, (1, 0)), edge(0, 2, (7, 3))], [10, 5, 5])
    rows = sorted(zip(tracks.track, tracks.image, tracks.keypoint, strict=True))
    groups = [[(i, k) for t, i, k in rows if t == track] for track in range(len(tracks))]
    assert sorted(groups) == [[(0, 5), (1, 1), (2, 0)], [(0, 6), (1, 2)], [(0, 7), (2, 3)]]
    assert len(build_tracks([], [])) == 0


def test_images_that_averaging_left_out_are_registered_by_resection():
    """An image whose relative poses are wrong, but whose matches are right, is not consistent with the others."""
    poses, keypoints = circle_of_poses(6), observe(circle_of_poses(6), points_around(150), 0.1)
    edges = match_pairs(keypoints, list(combinations(range(6), 2)), ignore)
    rng = np.random.default_rng(0)
    spoiled = [
        replace(edge, pose=replace(edge.pose, b_from_a=Pose(exp(rng.normal(0, 1, 3)), edge.pose.b_from_a.translation)))
        if edge.b == 5
        else edge
        for edge in edges
    ]
    (found,) = map_images(keypoints, KeypointRays.of(keypoints), spoiled, ignore)
    assert sorted(found.images.tolist()) == list(range(6))
    order = np.argsort(found.images)
    positions, _ = similarity_errors(found.cam_from_world[order], poses)
    assert positions.max() < 0.01
