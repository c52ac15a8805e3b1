"""Registration of images whose matches with any other image are too few for a relative pose."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from omnisight.features import match_features
from omnisight.features.keypoints import concatenate
from omnisight.geometry.pose import Pose
from omnisight.sfm.mapping import map_images
from omnisight.sfm.registration import register_frames
from omnisight.sfm.rig_images import RigImages
from omnisight.sfm.view_graph import match_pairs
from sfm.worlds import circle_of_poses, observe, points_around, similarity_errors, unit

POSES = circle_of_poses(7)
# Points of a place, and how many of the first ones the last image shows. The other images show half of each: half of
# those of the last image are one match too few for an edge.
POINTS, SHOWN = 240, 38


def views(last, others=0):
    """Return the keypoints of images of a place; half of those of the last one match with each other image.

    Parameters
    ----------
    last
        Pose of the last image.
    others
        Number of points of another place that the last image shows.
    """
    *place, seen = observe([*POSES[:-1], last], points_around(POINTS), 0.1)
    halves = [each[_by_point(each)[_half(k)]] for k, each in enumerate(place)]
    (elsewhere,) = observe([last], points_around(others, seed=6), 0.1, seed=10)
    return [*halves, concatenate([seen[_by_point(seen)[:SHOWN]], elsewhere])]


def _by_point(keypoints):
    """Return the keypoints in an order of the points that is the same in all images."""
    return np.argsort(keypoints.descriptors[:, 0])


def _half(seed):
    """Return the indices of a random half of the first points, and of the others."""
    rng = np.random.default_rng(seed)
    return np.concatenate([rng.permutation(SHOWN)[: SHOWN // 2], SHOWN + rng.permutation(POINTS - SHOWN)[::2]])


def registered(keypoints, images=None):
    """Return the frames that are registered in the map of all images but the last, and their poses."""
    images = RigImages.of(keypoints) if images is None else images
    graph = match_pairs(keypoints, list(combinations(range(len(keypoints)), 2)), ignore)
    last = len(keypoints) - 1
    inside = graph.without_images(np.arange(len(keypoints)) == last)
    (found,) = map_images(keypoints, images, inside, ignore)
    assert found.verified.tolist() == list(range(last))
    added = register_frames(
        replace(found, graph=replace(graph, repeatability=found.graph.repeatability)), inside.edges, NONE, keypoints
    )
    return found, added


NONE = np.zeros(0, np.intp)


def ignore(*_):
    pass


def test_an_image_without_a_relative_pose_is_registered_by_its_matches_with_all_images():
    keypoints = views(POSES[-1])
    graph = match_pairs(keypoints, list(combinations(range(7), 2)), ignore)
    assert {image for edge in graph.edges for image in edge.images} == set(range(6))
    (found,) = map_images(keypoints, RigImages.of(keypoints), graph, ignore)
    assert sorted(found.frames.tolist()) == sorted(found.verified.tolist()) == list(range(7))
    positions, rotations = similarity_errors(found.rig_from_world[np.argsort(found.frames)], POSES)
    assert positions.max() < 0.02
    assert rotations.max() < 0.1


@pytest.mark.parametrize(("others", "frames"), [(0, [6]), (600, [])])
def test_an_image_of_a_place_that_looks_alike_is_refused(others, frames):
    """It shows the same object as the map from the same side, and nothing else of its place."""
    _, added = registered(views(POSES[-1], others=others))
    assert added.frames.tolist() == frames


def test_an_image_of_repeated_structure_is_registered():
    """Descriptors of two points each are nearly equal: no match passes the ratio test."""
    place, repeated = observe(POSES, points_around(60), 0.1), observe(POSES, points_around(40, seed=5), 0.1, seed=9)
    rng = np.random.default_rng(0)
    difference = rng.normal(0, 0.08 / 8, (20, 64))
    for each in repeated:
        order = _by_point(each)
        each.descriptors[order[1::2]] = each.descriptors[order[::2]] + difference
        each.descriptors[:] = unit(each.descriptors + rng.normal(0, 0.2 / 8, (40, 64)))
    keypoints = [*(concatenate([a, b]) for a, b in zip(place[:-1], repeated[:-1], strict=True)), repeated[-1]]
    assert len(match_features(keypoints[0], keypoints[6])) < 5
    assert registered(keypoints)[1].frames.tolist() == [6]


def test_matches_of_far_points_are_not_missing():
    """The distances of the points that two images of nearly one place show are unknown."""
    beside = Pose(POSES[5].rotation, POSES[5].translation + 0.02)
    *keypoints, last = views(beside)
    far = observe([POSES[5], beside], 1e6 * points_around(300, seed=8), 0.1, seed=11)
    keypoints = [*keypoints[:-1], concatenate([keypoints[-1], far[0]]), concatenate([last, far[1]])]
    _, added = registered(keypoints)
    assert added.frames.tolist() == [6]


def test_keypoints_outside_of_the_domain_of_a_refined_camera_are_not_matched():
    keypoints = views(POSES[-1])
    images = RigImages.of(keypoints)
    bearings = images.bearings.copy()
    for image in (0, 6):
        bearings[images.offsets[image + 1] - 10 : images.offsets[image + 1]] = 0.0
    found, added = registered(keypoints, replace(images, bearings=bearings))
    assert added.frames.tolist() == [6]
    used = {keypoint for edge in added.edges for keypoint in edge.pairs[:, 0].tolist()}
    assert len(used) >= 20
    assert max(used) < SHOWN - 10
    order = np.argsort(found.frames)
    positions, _ = similarity_errors([*found.rig_from_world[order], *added.rig_from_world], POSES)
    assert positions.max() < 0.02


def test_no_image_is_in_two_models():
    """The last image of the first place shows an object of the second place, too."""
    *first, both = observe(circle_of_poses(7), points_around(150, seed=3), 0.1, seed=12)
    *second, object_ = views(POSES[-1])
    both = both[_by_point(both)[:30]]
    keypoints = [*first, concatenate([both, object_]), *second]
    graph = match_pairs(keypoints, list(combinations(range(len(keypoints)), 2)), ignore)
    maps = map_images(keypoints, RigImages.of(keypoints), graph, ignore)
    assert [sorted(found.frames.tolist()) for found in maps] == [list(range(7)), list(range(7, 13))]
