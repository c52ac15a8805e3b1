import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from omnisight.sfm.spanning_forest import SpanningForest


@pytest.mark.parametrize("trees", [1, 3])
def test_sums_are_those_of_the_parts_that_each_edge_separates(trees):
    """Compare with the connected parts that are left when each edge is removed."""
    rng, count = np.random.default_rng(trees), 40
    names = rng.permutation(count)
    child = np.arange(trees, count)
    parent = child - trees * rng.integers(1, child // trees + 1)
    a, b = names[child], names[parent]
    forest = SpanningForest.of(count, a, b)
    assert len(np.unique(forest.tree)) == trees
    first, second = rng.integers(0, count, (2, 300))
    values = rng.uniform(size=300)
    sums = forest.sums_across(first, second, values)
    label = connected_components(coo_array((np.ones(len(a)), (a, b)), shape=(count, count)), directed=False)[1]
    for edge in range(len(a)):
        kept = np.arange(len(a)) != edge
        graph = coo_array((np.ones(len(a) - 1), (a[kept], b[kept])), shape=(count, count))
        part = connected_components(graph, directed=False)[1]
        across = (label[first] == label[second]) & (part[first] != part[second])
        node = int(a[edge] if forest.parent[a[edge]] == b[edge] else b[edge])
        assert sums[node] == pytest.approx(values[across].sum())
        np.testing.assert_array_equal(forest.separates(node, first, second), across)
