"""Matching by descriptors, against OpenCV's, and along epipolar curves."""

import cv2
import numpy as np
import pytest

import omnisight as om
from omnisight.features import Keypoints, match_features, match_guided
from omnisight.geometry.rotation import exp, hat

POSE = om.Pose(exp((0.3, -0.8, 0.5)), np.array((0.5, -0.2, 0.3)))
SIGMA_RAD = 1e-3


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def keypoints(descriptors, bearings=None, sigma=SIGMA_RAD):
    """Return keypoints with isotropic covariances; their pixels are distinct."""
    n = len(descriptors)
    bearings = np.tile((0.0, 0.0, 1.0), (n, 1)) if bearings is None else bearings
    tangent = np.eye(3) - bearings[:, :, None] * bearings[:, None, :]
    pixels = np.stack([np.arange(n), np.zeros(n)], -1).astype(float)
    return Keypoints(pixels, bearings, sigma**2 * tangent, np.full(n, 0.01), descriptors)


def descriptors(kind, rng, count, of=None, noise=0.02):
    """Return random descriptors, or noisy copies of others; noise is the share of changed bits."""
    if kind == "orb":
        fresh = rng.integers(0, 256, (count, 32), np.uint8)
        if of is None:
            return fresh
        return of ^ np.packbits(rng.random((len(of), 256)) < noise, axis=1)
    fresh = np.abs(rng.normal(size=(count, 128)))
    return unit(fresh if of is None else of + noise / 5 * rng.normal(size=of.shape)).astype(np.float32)


@pytest.mark.parametrize("kind", ["sift", "orb"])
def test_mutual_matches_with_ratio_are_those_of_opencv(kind):
    rng = np.random.default_rng(0)
    a = descriptors(kind, rng, 1500)
    b = np.concatenate([descriptors(kind, rng, 0, a[rng.permutation(1500)[:700]], 0.1), descriptors(kind, rng, 900)])
    norm = cv2.NORM_L2 if kind == "sift" else cv2.NORM_HAMMING
    forward, backward = (cv2.BFMatcher(norm).knnMatch(x, y, k=2) for x, y in ((a, b), (b, a)))
    best_of_b = [first.trainIdx for first, _ in backward]
    expected = {
        (first.queryIdx, first.trainIdx)
        for first, second in forward
        if best_of_b[first.trainIdx] == first.queryIdx and first.distance < 0.8 * second.distance
    }
    matches = match_features(keypoints(a), keypoints(b))
    assert len(expected) > 300
    assert {tuple(pair) for pair in matches.pairs.tolist()} == expected
    assert (matches.ratio < 0.8).all()


@pytest.mark.parametrize("kind", ["sift", "orb"])
def test_matching_is_mutual_and_deterministic(kind):
    rng = np.random.default_rng(1)
    a = descriptors(kind, rng, 600)
    b = descriptors(kind, rng, 0, a[rng.permutation(600)], 0.15)
    there, again, back = (match_features(keypoints(x), keypoints(y), 1.0) for x, y in ((a, b), (a, b), (b, a)))
    assert len(there) > 200
    np.testing.assert_array_equal(there.pairs, again.pairs)
    np.testing.assert_array_equal(there.ratio, again.ratio)
    assert {(j, i) for i, j in back.pairs.tolist()} == {tuple(pair) for pair in there.pairs.tolist()}


def test_repeated_and_distant_descriptors_do_not_match():
    rng = np.random.default_rng(2)
    a = descriptors("sift", rng, 20)
    assert len(match_features(keypoints(a), keypoints(a))) == 20
    assert len(match_features(keypoints(a), keypoints(np.concatenate([a, a])))) == 0
    # The only candidate is not similar.
    assert len(match_features(keypoints(a[:1]), keypoints(a[1:2]))) == 0


def test_a_location_with_several_orientations_matches_once():
    rng = np.random.default_rng(3)
    a = descriptors("sift", rng, 30)
    twice = keypoints(np.concatenate([a, descriptors("sift", rng, 30)]))
    twice.pixels[30:] = twice.pixels[:30]
    matches = match_features(twice, twice)
    assert len(matches) == 30
    np.testing.assert_array_equal(matches.pairs[:, 0], matches.pairs[:, 1])


def scene(rng, count):
    """Return bearings of points all around two cameras, in both."""
    points = unit(rng.normal(size=(count, 3))) * rng.uniform(1, 5, (count, 1))
    return unit(points), unit(POSE @ points)


@pytest.mark.parametrize("kind", ["sift", "orb"])
def test_guided_matching_resolves_repeated_texture_in_all_directions(kind):
    rng = np.random.default_rng(4)
    in_a, in_b = scene(rng, 300)
    in_a, in_b = (unit(x + SIGMA_RAD * rng.normal(size=x.shape)) for x in (in_a, in_b))
    repeated = descriptors(kind, rng, 30)[np.arange(300) % 30]
    a, b = (keypoints(descriptors(kind, rng, 0, repeated), x) for x in (in_a, in_b))
    assert len(match_features(a, b)) < 30
    matches = match_guided(a, b, POSE)
    correct = matches.pairs[matches.pairs[:, 0] == matches.pairs[:, 1], 0]
    assert len(correct) > 0.9 * len(matches)
    assert len(correct) > 200
    assert (in_a[correct, 2] < 0).sum() > 50  # behind the camera
    assert len(match_guided(b, a, POSE.inverse())) > 200


def test_guided_matches_fulfil_the_epipolar_constraint_within_their_covariance():
    rng = np.random.default_rng(5)
    in_a, in_b = scene(rng, 400)
    essential = hat(unit(POSE.translation)) @ POSE.rotation
    normal = unit(in_a @ essential.T)
    # Displaced across the epipolar curve by 0 to 6 standard deviations of the sum of both.
    shift = np.linspace(0, 6, 400)
    share = np.linalg.norm(in_b @ essential, axis=1) / np.linalg.norm(in_a @ essential.T, axis=1)
    moved = unit(in_b + normal * (shift * SIGMA_RAD * np.hypot(1, share))[:, None])
    code = descriptors("sift", rng, 400)
    matches = match_guided(keypoints(code, in_a), keypoints(code, moved), POSE)
    np.testing.assert_array_equal(matches.pairs[:, 0], matches.pairs[:, 1])
    np.testing.assert_array_equal(matches.pairs[:, 0], np.flatnonzero(shift < 3))
    wider = match_guided(keypoints(code, in_a), keypoints(code, moved), POSE, sigma=10 * SIGMA_RAD)
    assert len(wider) == 400


def test_guided_matching_rejects_negative_distances():
    rng = np.random.default_rng(6)
    in_a, in_b = scene(rng, 100)
    code = descriptors("sift", rng, 100)
    assert len(match_guided(keypoints(code, in_a), keypoints(code, in_b), POSE)) == 100
    assert len(match_guided(keypoints(code, in_a), keypoints(code, -in_b), POSE)) == 0
    away = om.Pose(POSE.rotation, -POSE.translation)  # the same epipolar curves
    assert len(match_guided(keypoints(code, in_a), keypoints(code, in_b), away)) == 0
    far = unit(in_a @ POSE.rotation.T)
    assert len(match_guided(keypoints(code, in_a), keypoints(code, far), POSE)) == 100


def test_guided_matching_rejects_opposite_bearings():
    rng = np.random.default_rng(9)
    bearings = unit(rng.normal(size=(50, 3)))
    described = descriptors("sift", rng, 50)
    opposite = unit(-bearings @ POSE.rotation.T + SIGMA_RAD * rng.normal(size=bearings.shape))
    a, b = keypoints(described, bearings), keypoints(described, opposite)
    far_from_baseline = np.abs(b.bearings @ unit(POSE.translation)) < 0.99
    assert far_from_baseline.sum() > 40
    assert not far_from_baseline[match_guided(a, b, POSE).pairs[:, 0]].any()


def test_matching_reports_different_descriptors_and_a_zero_translation():
    rng = np.random.default_rng(7)
    sift, orb = (keypoints(descriptors(kind, rng, 5)) for kind in ("sift", "orb"))
    with pytest.raises(ValueError, match="descriptors of different kinds"):
        match_features(sift, orb)
    with pytest.raises(ValueError, match="translation of b_from_a is zero"):
        match_guided(sift, sift, om.Pose())


def test_the_representation_of_matches_is_short():
    code = descriptors("orb", np.random.default_rng(8), 7)
    assert repr(match_features(keypoints(code), keypoints(code))) == "Matches(7)"
