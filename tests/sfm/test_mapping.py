from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

import omnisight as om
from omnisight.features.keypoints import concatenate
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import exp
from omnisight.sfm.extrinsics import estimate_extrinsics
from omnisight.sfm.mapping import map_images
from omnisight.sfm.result import build_reconstruction
from omnisight.sfm.rig_images import RigImages
from omnisight.sfm.tracks import build_tracks
from omnisight.sfm.view_graph import Edge, match_pair, match_pairs, overlapping_pairs
from sfm.worlds import circle_of_poses, observe, points_around, sensors_apart, similarity_errors, unit


def ignore(*_):
    pass


def mapped(keypoints):
    graph = match_pairs(keypoints, list(combinations(range(len(keypoints)), 2)), ignore)
    return map_images(keypoints, RigImages.of(keypoints), graph, ignore)


def test_cameras_on_a_circle_are_mapped_with_points_and_noise():
    poses, points = circle_of_poses(8), points_around(150)
    (found,) = mapped(observe(poses, points, 0.1))
    positions, rotations = similarity_errors(found.rig_from_world, poses)
    assert found.frames.tolist() == list(range(8))
    assert positions.max() < 0.01
    assert rotations.max() < 0.1
    assert len(found.points) > 145
    assert len(found.tracks.track) > 7.5 * len(found.points)
    assert 0.9 < found.noise.sigma < 1.1


def test_the_map_is_deterministic():
    keypoints = observe(circle_of_poses(5), points_around(80), 0.1)
    (a,), (b,) = mapped(keypoints), mapped(keypoints)
    assert np.array_equal(a.rig_from_world, b.rig_from_world)
    assert np.array_equal(a.points, b.points)


def test_two_places_give_two_maps():
    here, there = (
        observe(circle_of_poses(5), points_around(100), 0.1),
        observe(circle_of_poses(4), points_around(100, seed=8), 0.1, seed=9),
    )
    maps = mapped([*here, *there])
    assert [found.frames.tolist() for found in maps] == [[0, 1, 2, 3, 4], [5, 6, 7, 8]]


def test_images_whose_relative_poses_are_all_contradicted_have_no_map(monkeypatch):
    def contradicted_pairs(self, images, graph):
        return {edge.images for edge in self.edges}

    monkeypatch.setattr("omnisight.sfm.initial_poses._Placement.contradicted_pairs", contradicted_pairs)
    assert mapped(observe(circle_of_poses(4), points_around(100), 0.1)) == []


def test_images_of_one_place_have_orientations_and_no_points():
    rng = np.random.default_rng(4)
    poses = [Pose(), *(Pose(exp(rng.normal(0, 1, 3))) for _ in range(4))]
    (found,) = mapped(observe(poses, points_around(100), 0.05))
    assert len(found.points) == 0
    assert not found.rig_from_world[:, :, 3].any()
    true = np.array([pose.rotation for pose in poses])
    np.testing.assert_allclose(found.rig_from_world[:, :, :3], true, atol=2e-3)


def test_wrong_matches_are_not_observations():
    """A third of the keypoints of each image show other points than those that their descriptors belong to."""
    poses, points = circle_of_poses(6), points_around(150)
    right = observe(poses, points, 0.1)
    wrong = observe(
        circle_of_poses(6, seed=11), points_around(75, seed=12)[np.random.default_rng(0).permutation(75)], 0.1
    )
    keypoints = [concatenate([a, b]) for a, b in zip(right, wrong, strict=True)]
    maps = mapped(keypoints)
    positions, _ = similarity_errors(maps[0].rig_from_world, poses)
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
        return Edge(a, b, Pose(), np.zeros((6, 6)), "general", np.array(pairs))

    tracks = build_tracks([edge(0, 1, (5, 1), (6, 2)), edge(1, 2, (1, 0)), edge(0, 2, (7, 3))], [10, 5, 5])
    rows = sorted(zip(tracks.track, tracks.image, tracks.keypoint, strict=True))
    groups = [[(i, k) for t, i, k in rows if t == track] for track in range(len(tracks))]
    assert sorted(groups) == [[(0, 5), (1, 1), (2, 0)], [(0, 6), (1, 2)], [(0, 7), (2, 3)]]
    assert len(build_tracks([], [])) == 0


def test_images_that_averaging_left_out_are_registered_by_resection():
    """An image whose relative poses are wrong, but whose matches are right, is not consistent with the others."""
    poses, keypoints = circle_of_poses(6), observe(circle_of_poses(6), points_around(150), 0.1)
    graph = match_pairs(keypoints, list(combinations(range(6), 2)), ignore)
    rng = np.random.default_rng(0)
    spoiled = [
        replace(edge, b_from_a=Pose(exp(rng.normal(0, 1, 3)), edge.b_from_a.translation)) if edge.b == 5 else edge
        for edge in graph.edges
    ]
    (found,) = map_images(keypoints, RigImages.of(keypoints), replace(graph, edges=spoiled), ignore)
    assert sorted(found.frames.tolist()) == list(range(6))
    order = np.argsort(found.frames)
    positions, _ = similarity_errors(found.rig_from_world[order], poses)
    assert positions.max() < 0.01


# Points of the world that the last of the images of `misled` shows: its first keypoints.
SEEN_POINTS = 60


def misled(poses, moved):
    """Return keypoints of images of a world, the last of which shows an object that moved and was in one image before.

    Three points of the world are where the last image would show them if the world had moved with the object.
    """
    world, keypoints = points_around(150), observe(poses, points_around(150), 0.1)
    wrong = Pose(exp(np.array([0.0, 0.4, 0.1])), np.array([1.5, 0.5, -1.0])) @ poses[-1]
    before, after = observe([poses[-2], wrong], points_around(moved, seed=5), 0.1, seed=9)
    right, moved_world = keypoints[-1], observe([wrong], world, 0.1)[0]
    order, other = (np.argsort(each.descriptors[:, 0]) for each in (right, moved_world))
    three = moved_world[other[SEEN_POINTS : SEEN_POINTS + 3]]
    last = concatenate([right[order[:SEEN_POINTS]], after, three])
    return [*keypoints[:-2], concatenate([keypoints[-2], before]), last]


def turned(edge, seed):
    """Return an edge with a wrong rotation."""
    wrong = exp(np.random.default_rng(seed).normal(0, 1, 3))
    return replace(edge, b_from_a=Pose(wrong, edge.b_from_a.translation))


def misled_graph(keypoints):
    """Return the view graph of misled images, and the edge of the last image that follows the object that moved."""
    graph = match_pairs(keypoints, [*combinations(range(6), 2), (3, 6), (4, 6)], ignore)
    by_object = match_pair(keypoints, 5, 6, without=np.column_stack([np.full(SEEN_POINTS, -1), np.arange(SEEN_POINTS)]))
    return graph, by_object


@pytest.mark.parametrize("moved", [40, 70])
def test_a_pose_that_is_not_verified_is_replaced_if_more_verified_points_agree_with_another(moved):
    """Averaging places an image by an object that moved, because its other relative poses are wrong."""
    poses = circle_of_poses(7)
    keypoints = misled(poses, moved)
    graph, by_object = misled_graph(keypoints)
    assert len(by_object.pairs) == pytest.approx(moved + 3, abs=3)
    *others, by_3, by_4 = graph.edges
    halves = (replace(turned(edge, k), pairs=edge.pairs[k::2]) for k, edge in enumerate((by_3, by_4)))
    (found,) = map_images(
        keypoints, RigImages.of(keypoints), replace(graph, edges=[*others, *halves, by_object]), ignore
    )
    order = np.argsort(found.frames)
    assert found.frames[order].tolist() == sorted(found.verified.tolist()) == list(range(7))
    positions, _ = similarity_errors(found.rig_from_world[order], poses)
    assert positions.max() < 0.05


def test_a_wrong_pose_is_not_verified_if_the_image_was_not_compared_with_others_of_the_place():
    poses = circle_of_poses(7)
    keypoints = misled(poses, 70)
    graph, by_object = misled_graph(keypoints)
    apart = replace(graph.without_images(np.arange(7) == 6), edges=[*graph.edges[:-2], by_object])
    (found,) = map_images(keypoints, RigImages.of(keypoints), apart, ignore)
    order = np.argsort(found.frames)
    assert found.frames[order].tolist() == list(range(7))
    assert found.is_verified[order].tolist() == [True] * 6 + [False]
    positions, _ = similarity_errors(found.rig_from_world[order], poses)
    assert positions.max() > 0.05


@pytest.mark.parametrize(("others", "is_verified"), [(0, True), (300, False)])
def test_an_image_that_shows_one_object_of_the_place_and_nothing_else_of_it_is_not_verified(others, is_verified):
    """An object of the same shape is in another room: an image of that room also shows what this one lacks."""
    poses, world = circle_of_poses(7), points_around(150)
    *here, there = observe(poses, world, 0.1)
    is_object = np.isin(there.descriptors[:, 0], sorted(there.descriptors[:, 0])[:30])
    (room,) = observe([Pose()], points_around(max(others, 1), seed=5), 0.1, seed=9)
    last = concatenate([there[np.flatnonzero(is_object)], room[:others]])
    (found,) = mapped([*here, last])
    order = np.argsort(found.frames)
    assert found.frames[order].tolist() == list(range(7))
    assert found.is_verified[order].tolist() == [True] * 6 + [is_verified]


TURNS = [Pose(exp(np.array([0.0, 0.3 * k, 0.0]))) for k in range(4)]


@pytest.mark.parametrize(("poses", "distance"), [(circle_of_poses(2), 1.0), (TURNS, 1e6)], ids=["two", "one place"])
def test_two_images_and_images_of_one_place_have_nothing_to_verify(poses, distance):
    keypoints = observe(poses, distance * points_around(100), 0.1)
    (found,) = mapped(keypoints)
    assert len(found.points) == 0 or len(found.frames) == 2
    assert reconstruction_of(found, keypoints).unverified == ()


def reconstruction_of(found, keypoints):
    """Return the reconstruction of a map of images 0.jpg, 1.jpg and so on."""
    names, colors = [f"{k}.jpg" for k in range(len(keypoints))], [np.zeros((len(k), 3), np.uint8) for k in keypoints]
    return build_reconstruction(found, om.Rig((om.sphere(100),), (Pose(),), ("camera",)), names, keypoints, colors)


def test_covariances_are_relative_to_a_verified_image():
    keypoints = misled(circle_of_poses(7), 60)[::-1]
    graph = match_pairs(keypoints, list(combinations(range(1, 7), 2)), ignore)
    by_object = match_pair(keypoints, 0, 1, without=np.column_stack([np.arange(SEEN_POINTS), np.full(SEEN_POINTS, -1)]))
    (found,) = map_images(keypoints, RigImages.of(keypoints), replace(graph, edges=[*graph.edges, by_object]), ignore)
    assert sorted(found.frames.tolist()) == list(range(7))
    assert found.is_verified.tolist() == [True] * 6 + [False]
    assert found.frames[-1] == 0
    assert reconstruction_of(found, keypoints).unverified == ("0.jpg",)


def rig_views(frames, sensors, points, *, field_deg=360.0, sigma_deg=0.05):
    """Return the keypoints of all sensors in all frames, sensor by sensor, with their sensors and frames."""
    sensor, frame = np.divmod(np.arange(len(sensors) * len(frames)), len(frames))
    every = observe([sensors[s] @ frames[f] for s, f in zip(sensor, frame, strict=True)], points, sigma_deg)
    return [k[k.bearings[:, 2] > np.cos(np.radians(field_deg / 2))] for k in every], sensor, frame


@pytest.mark.parametrize("field_deg", [360.0, 190.0])
def test_a_rig_of_known_sensors_is_mapped_in_metres(field_deg):
    frames, sensors = circle_of_poses(7), sensors_apart(3)
    keypoints, sensor, frame = rig_views(frames, sensors, points_around(200), field_deg=field_deg)
    matrices = np.array([pose.matrix for pose in sensors])
    images = RigImages.of(keypoints, sensor, 3).on_rig(frame, matrices, is_known=True)
    pairs = list(combinations(range(len(keypoints)), 2))
    (found,) = map_images(keypoints, images, match_pairs(keypoints, pairs, ignore, images.known_pose), ignore)
    assert found.frames.tolist() == list(range(7))
    true = np.array([pose.matrix for pose in frames])
    np.testing.assert_allclose(found.rig_from_world, true, atol=5e-3)


def test_unknown_poses_of_sensors_are_estimated():
    frames, sensors = circle_of_poses(7), sensors_apart(2)
    keypoints, sensor, frame = rig_views(frames, sensors, points_around(200), field_deg=220.0)
    independent = RigImages.of(keypoints, sensor, 2)
    graph = match_pairs(keypoints, list(combinations(range(len(keypoints)), 2)), ignore)
    (found,) = map_images(keypoints, independent, graph, ignore)
    poses, used = estimate_extrinsics(found, frame)
    assert used.tolist() == [0, 7]
    images = independent.on_rig(frame, poses, is_known=False)
    graph = match_pairs(keypoints, list(combinations(range(len(keypoints)), 2)), ignore, images.known_pose)
    (refined,) = map_images(keypoints, images, graph, ignore, refines_sensors=True)
    assert refined.frames.tolist() == list(range(7))
    found, true = Pose.of_matrix(refined.sensor_from_rig[1]), sensors[1]
    np.testing.assert_allclose(found.rotation, true.rotation, atol=1e-3)
    np.testing.assert_allclose(unit(found.translation), unit(true.translation), atol=5e-3)


def test_one_frame_of_a_rig_has_points():
    sensors = sensors_apart(3)
    keypoints, sensor, frame = rig_views([Pose()], sensors, points_around(100))
    matrices = np.array([pose.matrix for pose in sensors])
    images = RigImages.of(keypoints, sensor, 3).on_rig(frame + 1, matrices, is_known=True)  # a frame without images
    graph = match_pairs(keypoints, [(0, 1), (0, 2), (1, 2)], ignore, images.known_pose)
    (found,) = map_images(keypoints, images, graph, ignore)
    assert len(found.points) > 80
    true = points_around(100)
    nearest = np.linalg.norm(found.points[:, None] - true, axis=2).min(1) / np.linalg.norm(found.points, axis=1)
    assert np.median(nearest) < 0.02
