from itertools import combinations

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from omnisight.sfm.incidence import biconnected_parts, grouped


@pytest.mark.parametrize("values", [[], [5], [3, 1, 3, 3, 7, 1]])
def test_groups_are_the_indices_of_each_value(values):
    found = {value: indices.tolist() for value, indices in grouped(np.array(values, np.intp))}
    assert found == {value: [i for i, each in enumerate(values) if each == value] for value in values}
    assert list(found) == sorted(found)


def stays_connected(linked, nodes):
    """Return whether nodes of a graph stay connected without any one of them."""
    kept = [nodes] + [[n for n in nodes if n != without] for without in nodes]
    return all(connected_components(linked[np.ix_(k, k)])[0] == 1 for k in kept)


@pytest.mark.parametrize("seed", range(12))
def test_biconnected_parts_are_the_largest_that_stay_connected_without_any_node(seed):
    rng = np.random.default_rng(seed)
    upper = np.triu(rng.random((8, 8)) < (0.2, 0.3, 0.4)[seed % 3])
    linked = upper | upper.T
    biconnected = [
        set(nodes) for k in range(2, 9) for nodes in combinations(range(8), k) if stays_connected(linked, list(nodes))
    ]
    expected = [sorted(part) for part in biconnected if not any(part < other for other in biconnected)]
    found = [part.tolist() for part in biconnected_parts(csr_array(linked.astype(int)))]
    assert expected
    assert sorted(found) == sorted(expected)
