"""Two rooms with the same furniture: their images match, and must not be taken for images of one room."""

from dataclasses import replace
from itertools import combinations

import numpy as np

from omnisight.features.keypoints import concatenate
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import exp
from omnisight.sfm.contradicted_edges import without_contradicted_edges
from omnisight.sfm.initial_poses import initial_poses
from omnisight.sfm.mapping import map_images
from omnisight.sfm.missing_matches import (
    MIN_SUPPORT,
    KnownPoints,
    Links,
    PredictedMatches,
    contradicted_links,
    missing_matches,
    predicted_matches,
    predicted_matches_of_edges,
    repeatability,
)
from omnisight.sfm.rig_images import RigImages
from omnisight.sfm.scale_averaging import PointDistances
from omnisight.sfm.view_graph import ViewGraph, match_pair, match_pairs
from sfm.worlds import observe, similarity_errors, unit

APART = np.array([14.0, 0.0, 0.0])
IN_ROOM_A, IN_ROOM_B = range(4), range(4, 8)


def two_rooms(seed=0, has_landscape=True, turn=(0.0, 0.0, 0.0)):
    """Return the keypoints and poses of four images of each of two rooms, and of one in the door between them.

    Furniture is the same in both rooms, but turned by a rotation vector, and walls are not. The image in the door sees
    the walls of both rooms, and parts of a landscape that the other images see too.
    """
    rng = np.random.default_rng(seed)

    def points(count):
        return rng.uniform(3, 6, (count, 1)) * unit(rng.normal(size=(count, 3)))

    furniture, walls, others = points(60), points(500), points(500)
    centers = np.concatenate([rng.uniform(-0.5, 0.5, (4, 3)), rng.uniform(-0.5, 0.5, (4, 3)) + APART, [APART / 2]])
    poses = [Pose(np.eye(3), -center) for center in centers]
    parts = furniture, walls, furniture @ exp(np.array(turn)).T + APART, others + APART, 3 * points(40) + APART / 2
    seen = [observe(poses, part, 0.05, seed=k + 10) for k, part in enumerate(parts)]
    for first, copy in zip(seen[0], seen[2], strict=True):  # the same furniture looks the same
        copy.descriptors[np.argsort(_point_of(copy, furniture, 12))] = first.descriptors[
            np.argsort(_point_of(first, furniture, 10))
        ]
    rooms = [(0, 1, 4)] * 4 + [(2, 3, 4)] * 4 + [(1, 3, 4)]
    used = len(parts) if has_landscape else 4
    return [concatenate([seen[k][i] for k in of_room if k < used]) for i, of_room in enumerate(rooms)], poses


def _point_of(keypoints, points, seed):
    """Return which point (N,) each keypoint shows: that with the descriptor that `observe` gave it."""
    rng = np.random.default_rng(seed)
    descriptors = rng.normal(size=(len(points), 64))
    descriptors /= np.linalg.norm(descriptors, axis=1, keepdims=True)
    return (keypoints.descriptors @ descriptors.T).argmax(axis=1)


def matched(keypoints):
    return match_pairs(keypoints, list(combinations(range(len(keypoints)), 2)), lambda *_: None)


def contradicted_pairs(edges, keypoints):
    moving = [edge for edge in edges if edge.has_translation]
    predictions = predicted_matches_of_edges(moving, PointDistances(keypoints))
    lacking = missing_matches(predictions, repeatability([edge.images for edge in moving], predictions))
    return {edge.images for edge, lack in zip(moving, lacking, strict=True) if lack}


def test_edges_between_rooms_with_the_same_furniture_lack_matches():
    keypoints, _ = two_rooms(has_landscape=False)
    graph = matched(keypoints)
    between = {edge.images for edge in graph.edges if (edge.a in IN_ROOM_A) != (edge.b in IN_ROOM_A) and edge.b != 8}
    assert len(between) >= 10
    assert contradicted_pairs(graph.edges, keypoints) == between


def test_missing_matches_reduce_the_support_of_an_edge():
    keypoints, _ = two_rooms(has_landscape=False)
    graph, images = matched(keypoints), RigImages.of(keypoints)
    tested = without_contradicted_edges(graph, PointDistances(keypoints), images)
    between = [edge for edge in graph.edges if (edge.a in IN_ROOM_A) != (edge.b in IN_ROOM_A) and edge.b != 8]
    inside = [edge for edge in graph.edges if (edge.a in IN_ROOM_A) == (edge.b in IN_ROOM_A) and edge.b != 8]
    assert (tested.support_of(between) == MIN_SUPPORT).all()
    np.testing.assert_allclose(tested.support_of(inside), graph.support_of(inside), rtol=0.2)


def test_rooms_with_the_same_furniture_are_mapped_apart():
    keypoints, poses = two_rooms()
    found = map_images(keypoints, RigImages.of(keypoints), matched(keypoints), lambda *_: None)[0]
    assert len(found.frames) == 9
    positions, rotations = similarity_errors(found.rig_from_world, [poses[i] for i in found.frames])
    assert positions.max() < 0.02
    assert rotations.max() < 0.1


def test_rooms_that_only_furniture_connects_are_two_models():
    keypoints, poses = (each[:8] for each in two_rooms(has_landscape=False))
    maps = map_images(keypoints, RigImages.of(keypoints), matched(keypoints), lambda *_: None)
    assert sorted(found.frames.tolist() for found in maps) == [list(IN_ROOM_A), list(IN_ROOM_B)]
    for found in maps:
        positions, _ = similarity_errors(found.rig_from_world, [poses[i] for i in found.frames])
        assert positions.max() < 0.02


def test_edges_that_only_contradicted_ones_disagree_with_are_used():
    """The wrong edges of the furniture are more than the true ones of the landscape, and agree with each other."""
    keypoints, poses = (each[:8] for each in two_rooms(turn=(0.0, 1.0, 0.0)))
    graph = matched(keypoints)
    inside = [edge for edge in graph.edges if (edge.a in IN_ROOM_A) == (edge.b in IN_ROOM_A)]
    wrong = [edge for edge in graph.edges if edge not in inside]
    true = [match_pair(keypoints, edge.a, edge.b, without=edge.pairs) for edge in wrong if edge.a == 0]
    wrong = [edge for edge in wrong if edge.a != 0]
    assert sum(len(edge.pairs) for edge in wrong) > 3 * sum(len(edge.pairs) for edge in true)
    mixed = ViewGraph([*inside, *wrong, *true], graph.compared)
    placed = initial_poses(mixed, PointDistances(keypoints), RigImages.of(keypoints))
    assert placed.frames.tolist() == list(range(8))
    assert placed.contradicted == {edge.images for edge in wrong}
    positions, rotations = similarity_errors(placed.rig_from_world, poses)
    assert positions.max() < 0.1
    assert rotations.max() < 0.2


def test_a_pair_without_matches_contradicts_the_edge_that_places_it():
    """Frames 0-1-2 and 3-4 are linked strongly; 2-3 weakly, and 1 and 4 should see each other but do not."""
    links = Links(np.array([0, 1, 3, 2]), np.array([1, 2, 4, 3]), np.array([300.0, 200.0, 250.0, 40.0]))
    missing = Links(np.array([1]), np.array([4]), np.array([90.0]))
    assert contradicted_links(5, links, missing).tolist() == [False, False, False, True]
    few = missing._replace(matches=np.array([30.0]))
    assert not contradicted_links(5, links, few).any()
    none = Links(np.array([], int), np.array([], int), np.array([]))
    assert not contradicted_links(5, links, none).any()


def test_rotations_only_are_not_tested():
    keypoints, _ = two_rooms()
    graph = matched(keypoints)
    graph = replace(graph, edges=[replace(edge, motion="rotation only") for edge in graph.edges])
    tested = without_contradicted_edges(graph, PointDistances(keypoints), RigImages.of(keypoints))
    assert tested.edges == graph.edges
    assert not tested.support


def test_a_pair_with_more_wrong_matches_than_true_ones_gets_its_true_pose():
    """Furniture that is the same in two rooms has more matches than the landscape that both rooms see."""
    rng = np.random.default_rng(3)
    furniture, landscape, walls = (
        rng.uniform(low, high, (count, 1)) * unit(rng.normal(size=(count, 3)))
        for low, high, count in ((3, 6, 150), (20, 40, 90), (3, 6, 1200))
    )
    centers = [*rng.uniform(-0.5, 0.5, (3, 3)), *(rng.uniform(-0.5, 0.5, (3, 3)) + APART)]
    poses = [Pose(np.eye(3), -center) for center in centers]
    of_room = [(0, 2, 4), (1, 3, 4)]
    # The same seed gives the same descriptors.
    parts = ((furniture, 1), (furniture + APART, 1), (walls, 2), (walls[::-1] + APART, 3), (landscape + APART / 2, 4))
    seen = [observe(poses, part, 0.05, seed=seed) for part, seed in parts]
    keypoints = [concatenate([seen[part][i] for part in of_room[i // 3]]) for i in range(len(poses))]
    graph, images = matched(keypoints), RigImages.of(keypoints)

    def direction_error_deg(edge):
        true = (poses[edge.b] @ poses[edge.a].inverse()).translation
        return np.degrees(np.arccos(true @ edge.b_from_a.translation / np.linalg.norm(true)))

    across = [edge for edge in graph.edges if edge.a < 3 <= edge.b]
    assert min(direction_error_deg(edge) for edge in across) > 10
    found = [e for e in without_contradicted_edges(graph, PointDistances(keypoints), images).edges if e.a < 3 <= e.b]
    assert len(found) == len(across) == 9
    assert max(direction_error_deg(edge) for edge in found) < 1


def test_predicted_matches_are_those_of_unhidden_points_in_similar_directions():
    rng = np.random.default_rng(4)
    directions = unit(rng.normal(size=(2000, 3)))
    near, far = (KnownPoints.of(directions, np.arange(2000), np.full(2000, r)) for r in (3.0, 9.0))
    pairs = np.column_stack([np.arange(2000)] * 2)
    same = predicted_matches(near, near, Pose(), pairs)
    assert abs(same.predicted / 2000 - 1) < 0.02
    assert same.found == 2000
    turned = Pose(np.eye(3), np.array([0.0, 0.0, 0.5]))
    assert 1000 < predicted_matches(near, near, turned, pairs).predicted < 2000
    assert predicted_matches(near, far, Pose(), pairs).predicted < 1001  # the far points are behind the near ones


def test_most_pairs_can_be_of_places_that_look_alike():
    """In three rooms, images 2 m apart have most matches, but few are predicted; wrong poses predict many."""
    rooms = [(0, 1), (2, 3), (4, 5)]
    between = [pair for pair in combinations(range(6), 2) if pair not in rooms]
    right = PredictedMatches(predicted=100.0, found=60.0, matches=400, keypoints=4000)
    wrong = PredictedMatches(predicted=1000.0, found=148.0, matches=150, keypoints=4000)
    predictions = [right] * len(rooms) + [wrong] * len(between)
    lacking = missing_matches(predictions, repeatability(rooms + between, predictions))
    assert len(between) == 12
    assert (lacking[:3] == 0).all()
    np.testing.assert_allclose(lacking[3:], 0.6 * 1000 - 148)
