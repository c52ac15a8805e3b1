"""Differences of unknowns along the edges of a graph, its triangles and its spanning trees."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, depth_first_order, minimum_spanning_tree

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


def incidence_matrix(count: int, a: Indices, b: Indices) -> Any:
    """Return the sparse matrix (E, N - 1) of x_b - x_a along edges a, b (E,) of N unknowns with x_0 = 0."""
    rows, ones = np.arange(len(a)), np.ones(len(a))
    ends = np.tile(rows, 2), np.concatenate([a, b])
    return coo_array((np.concatenate([-ones, ones]), ends), shape=(len(a), count)).tocsr()[:, 1:]


def grouped(values: Indices) -> Iterator[tuple[int, Indices]]:
    """Yield each of the values (N,), increasing, with the indices where it is."""
    order = np.argsort(values, kind="stable")
    found, starts = np.unique(values[order], return_index=True)
    for value, first, last in zip(found.tolist(), starts, np.append(starts[1:], len(values)), strict=False):
        yield value, order[first:last]


class Triangles(NamedTuple):
    """Edges (T,) of the triangles i < j < k of a graph: its sides ij, jk and ik, whose edges can point either way."""

    ij: Indices
    jk: Indices
    ik: Indices


def triangles(a: Indices, b: Indices) -> Triangles:
    """Return the triangles of edges between the nodes a and b (E,); no two edges have the same ends."""
    first, last = np.minimum(a, b), np.maximum(a, b)
    number = {(int(i), int(j)): e for e, (i, j) in enumerate(zip(first, last, strict=True))}
    following: dict[int, set[int]] = {}
    for i, j in number:
        following.setdefault(i, set()).add(j)
    nothing: set[int] = set()
    found = [
        (e, number[j, k], number[i, k])
        for (i, j), e in number.items()
        for k in following[i] & following.get(j, nothing)
    ]
    return Triangles(*np.array(found, np.intp).reshape(-1, 3).T)


def unique_edges(a: Indices, b: Indices, cost: Array) -> Indices:
    """Return the edge of least cost of each pair of nodes that edges a, b (E,) connect."""
    order = np.lexsort((cost, np.maximum(a, b), np.minimum(a, b)))
    ends = np.column_stack([np.minimum(a, b), np.maximum(a, b)])[order]
    return order[np.append(True, (np.diff(ends, axis=0) != 0).any(axis=1))[: len(order)]]


def spanning_tree(count: int, a: Indices, b: Indices, cost: Array) -> Indices:
    """Return the edges of the spanning tree of least total cost > 0; no two edges have the same ends."""
    first, last = np.minimum(a, b), np.maximum(a, b)
    tree = minimum_spanning_tree(csr_array(coo_array((cost, (first, last)), shape=(count, count)))).tocoo()
    order = np.lexsort((last, first))
    keys = first[order] * count + last[order]
    return order[np.searchsorted(keys, tree.coords[0].astype(np.intp) * count + tree.coords[1])]


def supported_tree(count: int, a: Indices, b: Indices, support: Array, is_confirmed: NDArray[np.bool_]) -> Indices:
    """Return the edges of a spanning tree: as few that are not confirmed as possible, and those with most support.

    The support is at least 1, and no two edges have the same ends.
    """
    return spanning_tree(count, a, b, 1 / support + np.where(is_confirmed, 0.0, 1.0))


def biconnected_parts(linked: Any) -> list[Indices]:
    """Return the largest parts of a graph that stay connected without any one of their nodes, in which parts overlap.

    They are found by depth-first search (J. Hopcroft and R. Tarjan, Efficient algorithms for graph manipulation, 1973):
    a node begins a part if no edge leads from its subtree to a node before its parent.

    Parameters
    ----------
    linked
        Sparse symmetric matrix (N, N), not 0 at the edges.
    """
    label = connected_components(linked, directed=False)[1]
    starts, sizes = np.unique(label, return_index=True, return_counts=True)[1:]
    a, b = linked.nonzero()
    parts = list[list[int]]()
    for start in starts[sizes > 1].tolist():
        order, parent = depth_first_order(linked, start, directed=False)
        rank = np.full(len(label), -1)
        rank[order] = np.arange(len(order))
        inside, first, part = rank[a] >= 0, rank.copy(), np.zeros(len(label), np.intp)
        np.minimum.at(first, a[inside], rank[b[inside]])
        for node in order[:0:-1].tolist():
            first[parent[node]] = min(first[parent[node]], first[node])
        for node in order[1:].tolist():
            if first[node] == rank[parent[node]]:
                part[node] = len(parts)
                parts.append([int(parent[node])])
            else:
                part[node] = part[parent[node]]
            parts[part[node]].append(node)
    return [np.sort(np.array(each, np.intp)) for each in parts]
