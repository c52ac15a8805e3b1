"""Pose graphs against scipy's least squares, with wrong edges, and by Monte Carlo."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from omnisight.geometry import rotation as so3
from omnisight.optim.pose_graph import PoseGraph, RelativeEdges, Similarities, optimize_pose_graph

SIGMA = np.array([0.01] * 3 + [0.02] * 3 + [0.01])


def circle(count=24, radius=10.0):
    """Return frames along a circle and a half, all of scale 1."""
    angle = 3 * np.pi * np.arange(count) / count
    position = radius * np.stack([np.sin(angle), 0.1 * np.cos(3 * angle), np.cos(angle)], -1)
    return Similarities(so3.exp(np.outer(angle, (0.1, 1.0, 0.0))), position, np.zeros(count))


def measured(nodes, a, b, rng, sigma=SIGMA, may_be_wrong=False):
    """Return edges with noise."""
    a, b = np.array(a), np.array(b)
    exact = nodes[a].inverse() @ nodes[b]
    noise = sigma * rng.normal(size=(len(a), 7))
    root = np.tile(np.diag(1 / sigma), (len(a), 1, 1))
    return RelativeEdges(a, b, exact.moved(noise), root, np.full(len(a), may_be_wrong))


def chained(edges, count):
    """Return the nodes that the first edges imply."""
    nodes = Similarities(np.eye(3)[None], np.zeros((1, 3)), np.zeros(1))
    for k in range(count - 1):
        nodes = nodes.joined(nodes[[k]] @ edges.a_from_b[[k]])
    return nodes


def in_frame_of_first(nodes):
    return nodes[np.zeros(len(nodes), int)].inverse() @ nodes


def graph_of_circle(seed, wrong=False, count=24):
    """Return edges, start and true nodes; loops join the second lap with the first."""
    rng = np.random.default_rng(seed)
    nodes = in_frame_of_first(circle(count))
    path = measured(nodes, range(count - 1), range(1, count), rng)
    lap = 2 * count // 3
    loops = measured(nodes, range(count - lap), range(lap, count), rng, may_be_wrong=True)
    edges = path.joined(loops)
    if wrong:
        # A consistent group: the frames at one place are taken for those of another.
        moved = measured(nodes, [2, 3, 4], [9, 10, 11], rng, may_be_wrong=True)
        truth = measured(nodes, [2, 3, 4], [2, 3, 4], rng, may_be_wrong=True)
        edges = edges.joined(replace(moved, a_from_b=truth.a_from_b))
    return edges, chained(path, count), nodes


@pytest.mark.parametrize("has_scale", [False, True])
def test_the_optimum_is_that_of_scipy_with_rotations_of_its_own(has_scale):
    edges, _, _ = graph_of_circle(0)
    relative = edges.a_from_b
    if has_scale:
        relative = Similarities(relative.rotation, relative.position, np.zeros(len(edges)))
    edges = replace(edges, a_from_b=relative, may_be_wrong=np.zeros(len(edges), bool))
    start = chained(edges, 24)
    found = optimize_pose_graph(edges, start, has_scale=has_scale).nodes

    def unpacked(x):
        x = np.concatenate([np.zeros(7), x]).reshape(-1, 7)
        return Rotation.from_rotvec(x[:, :3]), x[:, 3:6], np.zeros(len(x)) if has_scale else x[:, 6]

    def residuals(x):
        rotation, position, log_scale = unpacked(x)
        a, b, z = edges.a, edges.b, edges.a_from_b
        turn = (Rotation.from_matrix(z.rotation).inv() * rotation[a].inv() * rotation[b]).as_rotvec()
        shift = rotation[a].inv().apply(position[b] - position[a]) / np.exp(log_scale[a])[:, None] - z.position
        change = log_scale[b] - log_scale[a] - z.log_scale
        return (np.concatenate([turn, shift, change[:, None]], axis=1) / SIGMA).ravel()

    packed = np.concatenate(
        [Rotation.from_matrix(start.rotation).as_rotvec(), start.position, start.log_scale[:, None]], axis=1
    )
    solved = least_squares(residuals, packed[1:].ravel(), xtol=1e-12, ftol=1e-12, gtol=1e-12)
    rotation, position, log_scale = unpacked(solved.x)
    assert PoseGraph(edges, has_scale).cost(found) == pytest.approx(solved.cost, rel=1e-5)
    assert np.allclose(found.rotation, rotation.as_matrix(), atol=2e-5)
    assert np.allclose(found.position, position, atol=2e-4)
    if not has_scale:
        assert np.allclose(found.log_scale, log_scale, atol=2e-5)
    else:
        assert not found.log_scale.any()


def test_the_derivatives_are_those_of_differences():
    edges, start, _ = graph_of_circle(1, wrong=True)
    graph = PoseGraph(edges, has_scale=False, scale=1e9)
    linearized, step = graph.linearize(start), 1e-6
    for column in (0, 4, 10, 60, 160):
        move = np.zeros(start.position.shape[0] * 7 - 7)
        move[column] = step
        full = np.concatenate([np.zeros(7), move])
        ahead, behind = (graph.residuals(graph.move(start, sign * full)).ravel() for sign in (1, -1))
        exact = linearized.jacobian[:, [column]].toarray()[:, 0]
        assert np.allclose((ahead - behind) / (2 * step), exact, rtol=1e-5, atol=1e-3)


def test_loops_correct_the_drift_and_a_consistent_group_of_wrong_ones_is_rejected():
    edges, start, nodes = graph_of_circle(2, wrong=True)
    found = optimize_pose_graph(edges, start, has_scale=False)
    assert found.is_correct[:-3].all()
    assert not found.is_correct[-3:].any()
    drift, left = (np.linalg.norm(each.position - nodes.position, axis=1).max() for each in (start, found.nodes))
    assert left < 0.5 * drift


def test_a_wrong_loop_alone_contradicts_the_odometry():
    rng = np.random.default_rng(0)
    nodes = in_frame_of_first(circle())
    path = measured(nodes, range(23), range(1, 24), rng)
    wrong = measured(nodes, [3], [3], rng, may_be_wrong=True)
    edges = path.joined(replace(wrong, b=np.array([9])))
    found = optimize_pose_graph(edges, chained(path, 24), has_scale=False)
    assert not found.is_correct[-1]
    assert np.allclose(found.nodes.position, chained(path, 24).position, atol=0.05)


def test_the_residuals_of_many_graphs_have_the_expected_chi_square():
    costs = []
    for seed in range(12):
        edges, start, _ = graph_of_circle(100 + seed)
        edges = replace(edges, may_be_wrong=np.zeros(len(edges), bool))
        found = optimize_pose_graph(edges, start, has_scale=False)
        costs.append((found.residuals**2).sum())
    freedom = 7 * (len(edges) - len(start) + 1)
    assert len(costs) == 12
    assert np.mean(costs) == pytest.approx(freedom, rel=4 * np.sqrt(2 / (freedom * 12)))
