import numpy as np
import pytest
from scipy.sparse import csr_array, hstack

from omnisight.sfm.graph_least_squares import heaviest_tree, normal_solver
from omnisight.sfm.incidence import incidence_matrix

COUNT = 60


def edges(rng):
    """Return the edges of a path, and random edges of near and of distant nodes, some of them repeated."""
    path = np.arange(COUNT - 1), np.arange(1, COUNT)
    near = rng.integers(0, COUNT - 5, 80)
    far = rng.integers(0, COUNT, (2, 20))
    a, b = np.concatenate([path[0], near, far[0]]), np.concatenate([path[1], near + rng.integers(1, 5, 80), far[1]])
    return a, b, 10.0 ** rng.uniform(-6, 2, len(a))


def test_the_heaviest_tree_connects_all_nodes_with_the_largest_weights():
    a, b, weights = edges(np.random.default_rng(0))
    in_tree = heaviest_tree(COUNT, a, b, weights)
    assert in_tree.sum() == COUNT - 1
    # Kruskal: an edge of the heaviest tree is the one that first connects its ends.
    label = np.arange(COUNT)
    for e in np.argsort(-weights):
        assert in_tree[e] == (label[a[e]] != label[b[e]])
        label[label == label[a[e]]] = label[b[e]]


@pytest.mark.parametrize("has_prior", [False, True])
def test_the_solution_is_that_of_the_normal_equations(has_prior):
    rng = np.random.default_rng(1)
    a, b, weights = edges(rng)
    matrix = csr_array(incidence_matrix(COUNT, a, b))
    prior = np.zeros(COUNT - 1)
    if has_prior:
        matrix = csr_array(hstack([matrix, csr_array(rng.normal(size=(len(a), 1)))]))
        prior = np.append(prior, 1e-3)
    dense = matrix.toarray()
    right = rng.normal(size=(matrix.shape[1], 2))
    expected = np.linalg.solve(dense.T @ (weights[:, None] * dense) + np.diag(prior), right)
    solve = normal_solver(matrix, weights, heaviest_tree(COUNT, a, b, weights), prior)
    found = solve(right)
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-3 * np.abs(expected).max())
    np.testing.assert_allclose(solve(right[:, 0]), found[:, 0])
