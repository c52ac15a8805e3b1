"""Maps in metres: from known positions, with errors and outliers, and from a known distance."""

from itertools import combinations

import numpy as np
import pytest

from omnisight.geometry.rotation import exp
from omnisight.sfm.georeference import georeferenced, robust_similarity, scaled
from omnisight.sfm.mapping import map_images
from omnisight.sfm.measurements import MeasuredDistance, MeasuredPositions, camera_positions
from omnisight.sfm.rig_images import RigImages
from omnisight.sfm.view_graph import match_pairs
from sfm.worlds import circle_of_poses, observe, points_around

POSES = circle_of_poses(8, radius=20.0)
TRUE = np.array([pose.inverse().translation for pose in POSES])

OFFSET = np.array([500, -200, 80])


@pytest.fixture(scope="module")
def found():
    keypoints = observe(POSES, 10 * points_around(120), 0.05)
    graph = match_pairs(keypoints, list(combinations(range(8), 2)), lambda *_: None)
    (result,) = map_images(keypoints, RigImages.of(keypoints), graph, lambda *_: None)
    return result


def positions_of(found):
    return -np.einsum("fji,fj->fi", found.rig_from_world[:, :, :3], found.rig_from_world[:, :, 3])


def test_the_map_takes_the_frame_of_known_positions(found):
    placed, georeference = georeferenced(found, TRUE + OFFSET)
    assert georeference
    assert placed.has_scale
    np.testing.assert_allclose(positions_of(placed), TRUE + OFFSET, atol=0.05)


def test_wrong_positions_are_outliers_and_unknown_ones_are_not_used(found):
    known = TRUE + np.random.default_rng(0).normal(0, 0.05, TRUE.shape)
    known[2] += (30, 0, 0)
    known[5] = np.nan
    placed, georeference = georeferenced(found, known)
    assert (georeference.images, georeference.inliers) == (7, 6)
    assert np.linalg.norm(positions_of(placed) - TRUE, axis=1).max() < 0.2


def test_the_scene_does_not_change(found):
    placed, _ = georeferenced(found, TRUE)
    assert placed.structure.squared_residuals(placed.bundle.rays).mean() == pytest.approx(
        found.structure.squared_residuals(found.bundle.rays).mean(), rel=0.05
    )


@pytest.mark.parametrize(
    ("known", "reason"),
    [
        (np.full((8, 3), np.nan), "3 or more are needed"),
        (TRUE[:, :1] * (1.0, 0.0, 0.0), "scatter"),
        (np.zeros((8, 3)), "scatter"),
    ],
)
def test_positions_that_do_not_determine_the_world_are_refused(found, known, reason):
    same, georeference = georeferenced(found, known)
    assert not georeference
    assert reason in georeference.reason
    assert same is found


def test_a_known_distance_scales_the_map(found):
    true = float(np.linalg.norm(TRUE[1] - TRUE[4]))
    placed, georeference = scaled(found, 1, 4, true)
    assert georeference
    positions = positions_of(placed)
    assert np.linalg.norm(positions[4] - positions[1]) == pytest.approx(true, rel=1e-9)
    assert np.linalg.norm(positions[7] - positions[2]) == pytest.approx(np.linalg.norm(TRUE[7] - TRUE[2]), rel=0.01)


def test_covariances_in_the_world_are_those_of_repeated_measurements(found):
    """Normalized squared errors of the positions, with new errors of observations and of known positions."""
    rng, squares = np.random.default_rng(3), []
    points = 10 * points_around(120)
    for trial in range(20):
        keypoints = observe(POSES, points, 0.05, seed=100 + trial)
        graph = match_pairs(keypoints, list(combinations(range(8), 2)), lambda *_: None)
        (result,) = map_images(keypoints, RigImages.of(keypoints), graph, lambda *_: None)
        sigma = np.array([0.3, 0.3, 0.6])
        placed, _ = georeferenced(result, TRUE + rng.normal(0, sigma, TRUE.shape))
        columns, covariance = placed.bundle.parameters[0], placed.bundle.covariances(placed.structure)[0]
        positions, derivatives = camera_positions(placed.rig_from_world, np.zeros((8, 3)))
        for column, position, true, by_step in zip(columns, positions, TRUE, derivatives, strict=True):
            of_position = by_step @ covariance.square(column) @ by_step.T
            squares.append((position - true) @ np.linalg.solve(of_position, position - true) / 3)
    # The standard deviations are estimated from 8 positions, so that the mean exceeds 1.
    assert 0.8 < np.mean(squares) < 1.6


@pytest.mark.parametrize("kind", ["positions", "distance"])
def test_derivatives_are_those_of_differences(kind):
    rng, poses = np.random.default_rng(0), np.array([pose.matrix for pose in POSES])
    frames, centers = np.array([1, 4]), rng.normal(size=(2, 3))
    measured = (
        MeasuredPositions(frames, centers, rng.normal(size=(2, 3)), np.array([0.1, 0.2, 0.3]))
        if kind == "positions"
        else MeasuredDistance(frames, centers, 3.0, 0.1)
    )
    _, of_frames, derivatives = measured.linearize(poses)
    for row, (used, by_step) in enumerate(zip(of_frames, derivatives, strict=True)):
        for frame, expected in zip(used, by_step, strict=True):
            for k, step in enumerate(1e-6 * np.eye(6)):
                ahead, back = poses.copy(), poses.copy()
                ahead[frame] = moved(poses[frame], step)
                back[frame] = moved(poses[frame], -step)
                change = measured.linearize(ahead)[0][row] - measured.linearize(back)[0][row]
                assert change / 2e-6 == pytest.approx(expected[k], rel=1e-4, abs=1e-5)


def moved(pose, step):
    return np.column_stack([exp(step[:3]) @ pose[:, :3], pose[:, 3] + step[3:]])


def test_a_similarity_is_found_among_outliers():
    rng = np.random.default_rng(1)
    a, rotation = rng.normal(size=(40, 3)), exp([0.3, -1.0, 2.0])
    b = 2.5 * a @ rotation.T + (1, 2, 3)
    b[:15] += rng.normal(0, 5, (15, 3))
    similarity, inlier = robust_similarity(a, b)
    assert similarity.scale == pytest.approx(2.5)
    np.testing.assert_allclose(similarity.rotation, rotation, atol=1e-9)
    assert not inlier[:15].any()
    assert inlier[15:].all()
