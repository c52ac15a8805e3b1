"""The bounding-box tree of a scene, built by the surface area heuristic."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Padding of the boxes against rounding, metres.
PADDING_M = 1e-6
# A solid longer than this share of its set is a child of its own: it would enlarge the boxes of both children.
HUGE_SHARE = 0.6


@dataclass(frozen=True)
class Node:
    """A node of the tree.

    Attributes
    ----------
    box
        (6,) low and high corner.
    solid
        Position in the order of the tree of the solid of a leaf; -1 for others.
    axis
        Axis along which the children are sorted.
    children
        At most two.
    huge
        Leaves with the huge solids of the set.
    """

    box: Array
    solid: int
    axis: int = 0
    children: Sequence["Node"] = ()
    huge: Sequence["Node"] = ()


def build_tree(bounds: Array) -> tuple[Array, NDArray[np.int64], list[int]]:
    """Return a bounding-box tree and the order of the solids in it.

    The tree is stored for each octant of ray directions, the nearer child first; see `Tree` of `_trace`.

    Parameters
    ----------
    bounds
        (N, 6) low and high corner of each solid.

    Returns
    -------
    boxes
        (8 M, 6).
    nodes
        (8 M, 2).
    order
        N indices.
    """
    if not len(bounds):
        return np.zeros((0, 6)), np.zeros((0, 2), np.int64), []
    order: list[int] = []
    root = _grow(bounds, np.arange(len(bounds)), order)
    boxes: list[Array] = []
    nodes: list[list[int]] = []
    for octant in range(8):
        _flatten(root, octant, boxes, nodes)
    return np.array(boxes), np.array(nodes, np.int64), order


def _grow(bounds: Array, members: NDArray[np.int64], order: list[int]) -> Node:
    inside = bounds[members]
    low, high = inside[:, :3].min(0), inside[:, 3:].max(0)
    box = np.concatenate([low - PADDING_M, high + PADDING_M])
    if len(members) == 1:
        order.append(int(members[0]))
        return Node(box, len(order) - 1)
    huge = (inside[:, 3:] - inside[:, :3]).max(1) > HUGE_SHARE * (high - low).max()
    axis, parts = _split(bounds, members[~huge])
    children = [_grow(bounds, part, order) for part in parts]
    return Node(box, -1, axis, children, [_grow(bounds, members[i : i + 1], order) for i in np.flatnonzero(huge)])


def _split(bounds: Array, members: NDArray[np.int64]) -> tuple[int, list[NDArray[np.int64]]]:
    """Split a set in at most two along an axis, with the least sum of surface area times count."""
    if len(members) < 2:
        return 0, [members] if len(members) else []
    best: tuple[float, int, int, NDArray[np.int64]] | None = None
    counts = np.arange(1, len(members))
    for axis in range(3):
        middles = bounds[members, axis] + bounds[members, axis + 3]
        along = members[np.argsort(middles, kind="stable")]
        before, after = _areas(bounds[along]), _areas(bounds[along[::-1]])[::-1]
        cost = before[:-1] * counts + after[1:] * counts[::-1]
        at = int(np.argmin(cost))
        if best is None or cost[at] < best[0]:
            best = float(cost[at]), axis, at + 1, along
    assert best is not None
    _, axis, at, along = best
    return axis, [along[:at], along[at:]]


def _areas(bounds: Array) -> Array:
    """Return half the surface area of the box around the first 1, 2, ..., N boxes."""
    low, high = np.minimum.accumulate(bounds[:, :3]), np.maximum.accumulate(bounds[:, 3:])
    x, y, z = (high - low).T
    return x * y + y * z + z * x


def _flatten(node: Node, octant: int, boxes: list[Array], nodes: list[list[int]]) -> None:
    """Append a node and its children, the nearer child for directions of an octant first."""
    here = len(nodes)
    boxes.append(node.box)
    nodes.append([0, node.solid])
    children = node.children[::-1] if octant >> node.axis & 1 else node.children
    for child in (*children, *node.huge):
        _flatten(child, octant, boxes, nodes)
    nodes[here][0] = len(nodes)
