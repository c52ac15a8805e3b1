"""Homographies between bearings of a plane, beyond the laws of all minimal solvers."""

import numpy as np
import pytest
from motions import bearings_of_plane, random_rotation, unit

from omnisight.twoview import four_point_homography, poses_from_homography


def draw(seed):
    return bearings_of_plane(np.random.default_rng(seed))


def test_a_homography_maps_bearings_to_bearings_and_not_to_their_opposites():
    sides = set()
    for seed in range(100):
        a, b, pose, normal = draw(seed)
        (homography,) = four_point_homography(a, b)
        np.testing.assert_allclose(unit(a @ homography.T), b, rtol=0, atol=1e-8)
        expected = pose[:, :3] + np.outer(pose[:, 3], normal)
        np.testing.assert_allclose(homography, expected, rtol=0, atol=1e-7 * np.abs(expected).max())
        sides.add(np.sign(np.linalg.det(homography)))
    assert sides == {-1.0, 1.0}  # the cameras are on the same side of the plane, or on both


def test_the_decomposition_reproduces_the_homography_and_contains_the_truth():
    counts = []
    for seed in range(200):
        a, _, pose, normal = draw(seed)
        homography = pose[:, :3] + np.outer(pose[:, 3], normal)
        poses, normals = poses_from_homography(homography, a)
        for found, n in zip(poses, normals, strict=True):
            np.testing.assert_allclose(found[:, :3] + np.outer(found[:, 3], n), homography, rtol=0, atol=1e-9)
            assert (a @ n > 0).all()
        errors = np.abs(poses - pose).max((1, 2)) + np.abs(normals - normal).max(1)
        assert errors.min() < 1e-9
        counts.append(len(poses))
    assert set(counts) == {1, 2}


def test_a_rotation_has_one_decomposition_without_plane():
    rotation = random_rotation(np.random.default_rng(1))
    poses, normals = poses_from_homography(rotation, np.eye(3))
    np.testing.assert_allclose(poses, [np.column_stack([rotation, np.zeros(3)])], rtol=0, atol=1e-14)
    np.testing.assert_array_equal(normals, np.zeros((1, 3)))


@pytest.mark.parametrize("step", [-3.0, -0.5, 0.5])
def test_a_translation_along_the_normal_is_found(step):
    a, _, _, normal = draw(2)
    poses, normals = poses_from_homography(np.eye(3) + step * np.outer(normal, normal), a)
    assert len(poses) >= 1
    for pose, n in zip(poses, normals, strict=True):
        np.testing.assert_allclose(pose, np.column_stack([np.eye(3), step * normal]), rtol=0, atol=1e-7)
        np.testing.assert_allclose(n, normal, rtol=0, atol=1e-7)


def test_bearings_of_a_mirror_image_have_no_homography():
    a, b, *_ = draw(3)
    b[0] = -b[0]
    assert len(four_point_homography(a, b)) == 0
