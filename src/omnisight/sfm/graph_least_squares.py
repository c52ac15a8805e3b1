"""Linear least squares of unknowns of the nodes of a graph, whose equations are of its edges."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from omnisight.optim.conjugate_gradients import conjugate_gradients
from omnisight.sfm.incidence import spanning_tree, unique_edges

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


def heaviest_tree(count: int, a: Indices, b: Indices, weights: Array) -> NDArray[np.bool_]:
    """Return which of the edges a, b (E,) between N nodes are in the spanning tree of the largest weights (E,)."""
    between = np.flatnonzero(a != b)
    best = between[unique_edges(a[between], b[between], -weights[between])]
    in_tree = np.zeros(len(a), np.bool_)
    in_tree[best[spanning_tree(count, a[best], b[best], 1 / weights[best])]] = True
    return in_tree


def normal_solver(
    matrix: Any, weights: Array, in_tree: NDArray[np.bool_], prior: Array | None = None
) -> Callable[[Array], Array]:
    """Return the function that solves A^T W A x = y for y (C,) or (C, K).

    Wrong edges link distant parts of a graph, so that a factor of the normal equations is nearly dense. That of the
    equations of a spanning tree has no fill-in; it is the preconditioner of conjugate gradients (D. Spielman, S. Teng,
    Nearly linear time algorithms for preconditioning and solving symmetric, diagonally dominant linear systems, 2014).

    Parameters
    ----------
    matrix
        A (R, C), sparse.
    weights
        Diagonal (R,) of W.
    in_tree
        (R,), whether the equation is of an edge of a spanning tree with large weights.
    prior
        (C,) information that is added for unknowns that are not of a node; 0 for all others.
    """
    prior = np.zeros(matrix.shape[1]) if prior is None else prior
    weighted = diags_array(weights) @ matrix
    normal = csr_array(matrix.T @ weighted + diags_array(prior))
    others = diags_array(np.where(prior > 0, normal.diagonal(), 0.0))
    near = csc_array(matrix[in_tree].T @ weighted[in_tree] + others)
    factor = splu(near, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})

    def solve(right: Array) -> Array:
        columns = right.reshape(len(right), -1).T
        return np.stack([conjugate_gradients(normal, factor.solve, y) for y in columns], -1).reshape(right.shape)

    return solve
