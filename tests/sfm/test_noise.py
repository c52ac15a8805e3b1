"""Noise of keypoints by the residuals of pairs of images."""

from dataclasses import replace
from itertools import combinations

from omnisight.sfm.noise import noise_of_pairs
from omnisight.sfm.rig_images import RigImages
from omnisight.sfm.view_graph import match_pairs
from sfm.worlds import circle_of_poses, observe, points_around


def matched(keypoints):
    return match_pairs(keypoints, list(combinations(range(len(keypoints)), 2)), lambda *_: None)


def test_pairs_reveal_the_noise_of_keypoints():
    seen = observe(circle_of_poses(4), points_around(800), 0.05)
    for factor in (0.5, 1.0, 2.0):
        keypoints = [replace(each, covariance=each.covariance / factor**2) for each in seen]
        edges = matched(keypoints).edges
        assert len(edges) == 6
        assert abs(noise_of_pairs(edges, RigImages.of(keypoints)) / factor - 1) < 0.1


def test_rotations_only_have_no_noise():
    keypoints = observe(circle_of_poses(2), points_around(800), 0.05)
    edges = [replace(edge, motion="rotation only") for edge in matched(keypoints).edges]
    assert edges
    assert noise_of_pairs(edges, RigImages.of(keypoints)) == 0.0
