import numpy as np
import pytest

from omnisight.geometry.rotation import exp
from omnisight.sfm.position_averaging import RelativePositions, average_positions
from omnisight.sfm.rotation_averaging import RelativeRotations, average_rotations
from omnisight.sfm.scale_averaging import DistanceTable, EdgeDistances, average_log_scales
from sfm.worlds import circle_of_poses, unit


def pairs(count, span):
    return np.array([(a, b) for a in range(count) for b in range(a + 1, min(a + span, count - 1) + 1)]).T


@pytest.mark.parametrize("wrong_share", [0.0, 0.3])
def test_rotations_are_those_of_the_cameras_although_edges_are_wrong(wrong_share):
    rng, poses = np.random.default_rng(3), circle_of_poses(20)
    a, b = pairs(20, 8)
    noise, is_wrong = np.radians(0.05), rng.random(len(a)) < wrong_share
    turns = np.where(is_wrong[:, None], unit(rng.normal(size=(len(a), 3))), rng.normal(0, noise, (len(a), 3)))
    rotations = np.array([poses[j].rotation @ poses[i].rotation.T for i, j in zip(a, b, strict=True)])
    averaged = average_rotations(
        20, RelativeRotations(a, b, exp(turns) @ rotations, *np.full((2, len(a)), [[noise], [1.0]]))
    )
    true = np.array([pose.rotation for pose in poses]) @ poses[0].rotation.T
    error = np.degrees(np.linalg.norm(averaged.rig_from_world - true, axis=(1, 2)) / np.sqrt(2))
    assert error.max() < 0.15
    assert not averaged.is_consistent[is_wrong].any()
    assert averaged.is_consistent[~is_wrong].mean() > 0.95


def test_a_confident_wrong_edge_that_closes_no_triangle_is_not_believed():
    poses = circle_of_poses(6)
    a, b = pairs(6, 3)
    rotations = np.array([poses[j].rotation @ poses[i].rotation.T for i, j in zip(a, b, strict=True)])
    is_wrong, sigma = (a == 2) & (b == 3), np.full(len(a), np.radians(0.1))
    rotations[is_wrong], sigma[is_wrong] = exp([0.0, 2.5, 0.0]) @ rotations[is_wrong], np.radians(0.001)
    averaged = average_rotations(6, RelativeRotations(a, b, rotations, sigma, np.ones(len(a))))
    assert (averaged.is_consistent == ~is_wrong).all()
    true = np.array([pose.rotation for pose in poses]) @ poses[0].rotation.T
    np.testing.assert_allclose(averaged.rig_from_world, true, atol=1e-6)


def test_edges_that_agree_with_each_other_do_not_outvote_one_with_more_support():
    """Six wrong edges link two halves of a chain, with the same wrong turn, and one right edge."""
    poses, inside = circle_of_poses(8), [(0, 1), (1, 2), (2, 3), (4, 5), (5, 6), (6, 7)]
    wrong = [(0, 4), (0, 5), (1, 4), (1, 5), (2, 6), (3, 7)]
    a, b = np.array([*inside, *wrong, (3, 4)]).T
    rotations = np.array([poses[j].rotation @ poses[i].rotation.T for i, j in zip(a, b, strict=True)])
    is_wrong = np.arange(len(a)) // 6 == 1
    turn = poses[4].rotation @ exp([0.0, 0.0, 1.5]) @ poses[4].rotation.T
    for i in np.flatnonzero(is_wrong):
        rotations[i] = poses[b[i]].rotation @ poses[4].rotation.T @ turn @ poses[4].rotation @ poses[a[i]].rotation.T
    support = np.where(is_wrong, 10.0, 200.0)
    averaged = average_rotations(8, RelativeRotations(a, b, rotations, np.full(len(a), np.radians(0.1)), support))
    assert (averaged.is_consistent == ~is_wrong).all()
    true = np.array([pose.rotation for pose in poses]) @ poses[0].rotation.T
    np.testing.assert_allclose(averaged.rig_from_world, true, atol=1e-6)
    equal = average_rotations(8, RelativeRotations(a, b, rotations, np.full(len(a), np.radians(0.1)), np.ones(len(a))))
    assert not np.allclose(equal.rig_from_world, true, atol=0.1)


def edge_distances(keypoints, log_distances):
    sigma = np.full(len(keypoints), 0.02, np.float32)
    return EdgeDistances(keypoints.astype(np.int32), log_distances.astype(np.float32), sigma)


def test_relative_scales_of_a_straight_path_follow_from_common_points():
    """Four cameras on a line: the directions of the edges do not determine the lengths."""
    rng, positions = np.random.default_rng(0), np.array([0.0, 1.0, 1.5, 3.5])
    points = rng.uniform(-5, 5, (200, 3))
    distances, ends = [], [(0, 1), (1, 2), (2, 3), (0, 2)]
    for a, b in ends:
        centers = np.array([(positions[a], 0, 0), (positions[b], 0, 0)])
        length = positions[b] - positions[a]
        from_both = np.linalg.norm(points - centers[:, None], axis=2) / length
        from_both[:, :20] *= 3  # wrong matches
        keypoints = np.concatenate([200 * a + np.arange(200), 200 * b + np.arange(200)])
        distances.append(edge_distances(keypoints, np.log(from_both).ravel()))
    log_scales, _, component = average_log_scales(DistanceTable.of(distances, 800))
    lengths = np.array([positions[b] - positions[a] for a, b in ends])
    np.testing.assert_allclose(np.exp(log_scales), lengths / lengths[0], rtol=1e-6)
    assert component.tolist() == [0, 0, 0, 0]


def test_edges_without_a_common_point_are_in_different_components():
    def edge(a, b, keypoints):
        both = np.concatenate([10 * a + np.array(keypoints), 10 * b + np.array(keypoints)])
        return edge_distances(both, np.zeros(len(both)))

    edges = [edge(0, 1, [1, 2]), edge(1, 2, [3, 4]), edge(2, 3, [4, 5])]
    component = average_log_scales(DistanceTable.of(edges, 40))[2]
    assert component[1] == component[2] != component[0]


def test_positions_are_those_of_the_cameras_although_edges_are_wrong():
    rng, count = np.random.default_rng(5), 20
    centers = np.array([pose.inverse().translation for pose in circle_of_poses(count)])
    a, b = pairs(count, 6)
    displacement = centers[b] - centers[a]
    is_wrong = rng.random(len(a)) < 0.15
    displacement[is_wrong] = rng.normal(size=(is_wrong.sum(), 3))
    ones = np.ones(len(a))
    edges = RelativePositions(a, b, displacement, np.zeros_like(displacement), 0.02 * ones, 0.01 * ones, ones)
    found = average_positions(count, edges).positions
    assert np.linalg.norm(found - centers, axis=1).max() < 0.02  # the stated noise


def test_positions_of_a_rig_have_its_unit():
    """Displacements between two sensors of a turning rig, in a unit of 0.4 of the rig's."""
    rng, poses = np.random.default_rng(7), circle_of_poses(15)
    frames = np.array([pose.inverse().translation for pose in poses])
    sensors = np.array([[0.2, 0, 0], [-0.1, 0.1, 0.2]])
    a, b = pairs(15, 5)
    of_a, of_b = rng.integers(0, 2, (2, len(a)))
    ends = [
        np.array([poses[f].rotation.T @ sensors[s] for f, s in zip(*end, strict=True)])
        for end in ((a, of_a), (b, of_b))
    ]
    arm = ends[1] - ends[0]
    displacement = 0.4 * (frames[b] - frames[a] + arm + rng.normal(0, 0.002, (len(a), 3)))
    ones = np.full(len(a), 0.4 * 0.002)
    found = average_positions(15, RelativePositions(a, b, displacement, arm, ones, ones, ones)).positions
    assert np.linalg.norm(found - frames, axis=1).max() < 0.02 * np.linalg.norm(frames, axis=1).max()


@pytest.mark.parametrize("seed", range(12))
def test_a_unit_that_no_displacement_determines_is_positive(seed):
    """Displacements along a path without turns, each between the same two sensors."""
    rng, count = np.random.default_rng(seed), 9
    a = np.arange(count - 1)
    arm = np.array([0.02, 0.01, 0.3]) + rng.normal(0, 1e-9, (count - 1, 3))
    displacement = rng.normal(size=(count - 1, 3))
    ones = np.full(count - 1, 0.01)
    positions, unit = average_positions(count, RelativePositions(a, a + 1, displacement, arm, ones, ones, 100 * ones))
    assert 0 < unit < np.inf
    assert np.isfinite(positions).all()
