"""Sums over the pairs of nodes that each edge of a forest separates."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class SpanningForest:
    """A forest over N nodes, whose edges are those between each node and its parent.

    Attributes
    ----------
    parent
        (N + 1,) parent of each node; that of the roots, and of itself, is the additional node N.
    order
        (N + 1,) the nodes, each after its parent.
    tree
        (N,) number of the tree of each node.
    """

    parent: Indices
    order: Indices
    tree: Indices

    @classmethod
    def of(cls, count: int, a: Indices, b: Indices) -> "SpanningForest":
        """Return the forest of the edges a, b (E,), which have no cycles."""
        trees, tree = connected_components(coo_array((np.ones(len(a)), (a, b)), shape=(count, count)), directed=False)
        _, roots = np.unique(tree, return_index=True)
        ends = np.append(a, roots), np.append(b, np.full(trees, count))
        graph = csr_array(coo_array((np.ones(len(ends[0])), ends), shape=(count + 1, count + 1)))
        order, parent = breadth_first_order(graph, count, directed=False)
        parent[count] = count
        return cls(parent.astype(np.intp), order, tree)

    @cached_property
    def depth(self) -> Indices:
        """Number of edges (N + 1,) between each node and node N."""
        depth = np.zeros(len(self.parent), np.intp)
        for node in self.order[1:].tolist():
            depth[node] = depth[self.parent[node]] + 1
        return depth

    @cached_property
    def _ancestors(self) -> list[Indices]:
        """Ancestors (N + 1,) of each node 1, 2, 4 ... generations ago."""
        found = [self.parent]
        while (1 << len(found)) <= int(self.depth.max()):
            found.append(found[-1][found[-1]])
        return found

    def sums_across(self, a: Indices, b: Indices, values: Array) -> Array:
        """Return the sums (N,) of the values (M,) of the pairs a, b (M,) that the edge of each node separates.

        Pairs of different trees are left out.
        """
        same = self.tree[a] == self.tree[b]
        a, b, values = a[same], b[same], values[same]
        sums = np.zeros(len(self.parent))
        np.add.at(sums, a, values)
        np.add.at(sums, b, values)
        np.add.at(sums, self._common_ancestor(a, b), -2 * values)
        for node in self.order[:0:-1].tolist():
            sums[self.parent[node]] += sums[node]
        return sums[:-1]

    def separates(self, node: int, a: Indices, b: Indices) -> Mask:
        """Return which pairs (M,) of the same tree the edge of a node separates."""
        below = np.zeros(len(self.parent), bool)
        below[node] = True
        for each in self.order[1:].tolist():
            below[each] |= below[self.parent[each]]
        return (self.tree[a] == self.tree[b]) & (below[a] != below[b])

    def _common_ancestor(self, a: Indices, b: Indices) -> Indices:
        """Return the deepest common ancestors (M,) of pairs (M. Bender, M. Farach-Colton, The LCA problem, 2000)."""
        deep = self.depth[a] >= self.depth[b]
        low, high = np.where(deep, a, b), np.where(deep, b, a)
        lift = self.depth[low] - self.depth[high]
        for k, ancestors in enumerate(self._ancestors):
            low = np.where(lift >> k & 1 == 1, ancestors[low], low)
        for ancestors in reversed(self._ancestors):
            apart = ancestors[low] != ancestors[high]
            low, high = np.where(apart, ancestors[low], low), np.where(apart, ancestors[high], high)
        return np.where(low == high, low, self.parent[low])
