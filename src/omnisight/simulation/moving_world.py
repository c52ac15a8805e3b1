"""Compiled scenes with moving objects: only the part that moves is compiled again for each time."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.simulation.bounding_box_tree import build_tree
from omnisight.simulation.solids import Solid
from omnisight.simulation.world import inverse_matrices


def merged_world(static: Any, moving: Any, solids: Sequence[Solid]) -> Any:
    """Return the `World` of a static one and a moving one, whose solids are in its order; light of the latter is 0."""
    textures = static.textures, moving.textures
    tables, levels = textures[1].tables.copy(), textures[1].levels.copy()
    tables[:, 0] += len(textures[0].levels)
    levels[:, 0] += len(textures[0].texels)
    faces = moving.faces.copy()
    faces[:, 0] += len(textures[0].tables)
    faces[:, 1] += len(static.light)
    merged = static._replace(
        first_face=np.concatenate([static.first_face, moving.first_face + len(static.faces)]),
        instance=np.concatenate([static.instance, moving.instance]),
        inward=np.concatenate([static.inward, moving.inward]),
        faces=np.concatenate([static.faces, faces]),
        light=np.concatenate([static.light, moving.light]),
        textures=textures[0]._replace(
            tables=np.concatenate([textures[0].tables, tables]),
            levels=np.concatenate([textures[0].levels, levels]),
            texels=np.concatenate([textures[0].texels, textures[1].texels]),
        ),
    )
    kinds = np.concatenate([static.tree.kinds, moving.tree.kinds])
    return merged._replace(tree=moved_tree(static.tree, static.tree._replace(kinds=kinds), solids))


def moved_tree(static: Any, merged: Any, solids: Sequence[Solid]) -> Any:
    """Return a merged tree with the moving solids at other places.

    Parameters
    ----------
    static
        Tree of the solids that do not move.
    merged
        Its `kinds` are those of the static solids, then of the moving ones.
    solids
        The moving ones, always in the same order.
    """
    count = len(static.kinds)
    bounds = np.array([np.concatenate(solid.bounds()) for solid in solids])
    boxes, nodes, order = build_tree(bounds)
    leaf = nodes[:, 1] >= 0
    nodes[leaf, 1] = count + np.array(order)[nodes[leaf, 1]]
    return merged._replace(
        local_from_world=np.concatenate([static.local_from_world, inverse_matrices(solids)]),
        boxes=_by_octant(static.boxes, boxes),
        nodes=_by_octant(_shifted(static.nodes, 0, len(nodes)), _shifted(nodes, len(static.nodes), len(static.nodes))),
    )


def _shifted(nodes: NDArray[np.int64], before: int, other: int) -> NDArray[np.int64]:
    """Return nodes (8 N, 2) whose next nodes are counted in a merged tree, after `before` / 8 nodes of each octant."""
    result, size = nodes.copy(), len(nodes) // 8
    octant = np.arange(len(nodes)) // size
    result[:, 0] += (octant + (before > 0)) * (other // 8)
    return result


def _by_octant(first: NDArray[Any], second: NDArray[Any]) -> NDArray[Any]:
    """Concatenate arrays (8 M, K) and (8 N, K) within each octant."""
    parts = [array.reshape(8, -1, array.shape[1]) for array in (first, second)]
    return np.ascontiguousarray(np.concatenate(parts, axis=1).reshape(-1, first.shape[1]))
