"""Cholesky factorization of sparse symmetric matrices of blocks by the multifrontal method.

Groups of columns are eliminated in an order of little fill-in. Columns that are eliminated together form a front: a
dense matrix of them and of the rows that they change, which LAPACK factors (I. Duff and J. Reid, The multifrontal
solution of indefinite sparse symmetric linear equations, 1983; J. Liu, The multifrontal method for sparse matrix
solution, 1992). A matrix without zeros is one front.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, get_blas_funcs, get_lapack_funcs
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from omnisight.optim.blas_threads import blas_threads_for
from omnisight.optim.block_matrix import BlockMatrix, BlockPattern

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Symmetric and triangular products and solutions, Cholesky factorization, and the inverse from its factor.
dsymm, dsyrk, dtrsm = get_blas_funcs(("symm", "syrk", "trsm"), dtype=np.float64)
dpotrf, dpotri = get_lapack_funcs(("potrf", "potri"), dtype=np.float64)
# Adjacent fronts are joined if it adds at most this share of zeros to their columns, or if both have few columns, whose
# calls cost more than their arithmetic.
MAX_ZEROS, FEW_COLUMNS = 0.2, 48


@dataclass(frozen=True, eq=False)
class Front:
    """Columns that are eliminated together, and the rows that they change.

    Attributes
    ----------
    columns
        (N,) columns of the matrix, in the order of elimination: those of the front first.
    count
        Number of columns of the front.
    parent
        Index of the front that contains the first of the other rows; -1 without others.
    in_parent
        (N - count,) rows of the parent that the other rows are.
    blocks
        Arrays (K,) of the blocks of the pattern that are assembled here: see `copy_blocks`.
    """

    columns: Indices
    count: int
    parent: int
    in_parent: Indices
    blocks: tuple[Indices, Indices, Indices, Indices, Indices]


def fronts_of(pattern: BlockPattern) -> list[Front]:
    """Return the fronts of the elimination of a matrix, each before its parent."""
    order, below = _elimination(pattern)
    position = np.argsort(order)
    groups = _joined(pattern.sizes[order], below)
    front_of = np.repeat(np.arange(len(groups)), [last - first for first, last in groups])
    owner = front_of[np.minimum(position[pattern.row], position[pattern.column])]
    by_owner = np.argsort(owner, kind="stable")
    starts = np.searchsorted(owner[by_owner], np.arange(len(groups) + 1))
    rows = [np.concatenate([np.arange(first, last), below[last - 1]]) for first, last in groups]
    # First row of each group in the front, and their number.
    tops = [np.concatenate([[0], np.cumsum(pattern.sizes[order[each]])]) for each in rows]
    fronts = list[Front]()
    for f, (first, last) in enumerate(groups):
        own, others = last - first, rows[f][last - first :]
        blocks = by_owner[starts[f] : starts[f + 1]]
        at_row, at_column = (
            tops[f][np.searchsorted(rows[f], position[side[blocks]])] for side in (pattern.row, pattern.column)
        )
        sizes = pattern.sizes[pattern.row[blocks]], pattern.sizes[pattern.column[blocks]]
        parent = int(front_of[others[0]]) if len(others) else -1
        in_parent = _ranges(tops[parent][np.searchsorted(rows[parent], others)], pattern.sizes[order[others]])
        columns = _ranges(pattern.starts[order[rows[f]]], pattern.sizes[order[rows[f]]])
        fronts.append(Front(columns, int(tops[f][own]), parent, in_parent, (blocks, *sizes, at_row, at_column)))
    return fronts


@dataclass(frozen=True, eq=False)
class MultifrontalFactor:
    """The factor L of a matrix A = L L^T.

    Attributes
    ----------
    pattern, fronts
        Of the matrix.
    factors
        (N, count) columns of L of each front.
    """

    pattern: BlockPattern
    fronts: Sequence[Front]
    factors: Sequence[Array]

    @classmethod
    def of(cls, matrix: BlockMatrix, fronts: Sequence[Front]) -> "MultifrontalFactor":
        """Factor a matrix, given the fronts of its pattern.

        Raises
        ------
        LinAlgError
            If the matrix is not positive definite.
        """
        from omnisight.optim._multifrontal_kernel import copy_blocks, extend_add

        factors, waiting = list[Array](), dict[int, list[tuple[Array, Indices]]]()
        with blas_threads_for(max((len(front.columns) for front in fronts), default=0)):
            for f, front in enumerate(fronts):
                size, count = len(front.columns), front.count
                dense = np.zeros((size, size), order="F")
                copy_blocks(matrix.values, matrix.pattern.offsets, *front.blocks, dense, True)
                for update, rows in waiting.pop(f, ()):
                    extend_add(dense, update, rows)
                factor = dense[:, :count]
                factor[:count], failed = dpotrf(dense[:count, :count], lower=1, clean=1)
                if failed:
                    raise LinAlgError("the matrix is not positive definite")
                if size > count:
                    factor[count:] = dtrsm(1.0, factor[:count], factor[count:], side=1, lower=1, trans_a=1)
                    update = dsyrk(-1.0, factor[count:], beta=1.0, c=dense[count:, count:], lower=1)
                    waiting.setdefault(front.parent, []).append((update, front.in_parent))
                factors.append(factor.copy(order="F"))
        return cls(matrix.pattern, fronts, factors)

    def solve(self, right: Array) -> Array:
        """Return the solution of A x = right, (C,) or (C, K)."""
        x = np.array(right if right.ndim > 1 else right[:, None], float)
        parts = list(zip(self.fronts, self.factors, strict=True))
        for front, factor in parts:
            own, others = front.columns[: front.count], front.columns[front.count :]
            x[own] = dtrsm(1.0, factor[: front.count], x[own], lower=1)
            x[others] -= factor[front.count :] @ x[own]
        for front, factor in reversed(parts):
            own, others = front.columns[: front.count], front.columns[front.count :]
            x[own] = dtrsm(1.0, factor[: front.count], x[own] - factor[front.count :].T @ x[others], lower=1, trans_a=1)
        return x.reshape(right.shape)

    def inverse(self) -> BlockMatrix:
        """Return the blocks of the inverse of A that are in its pattern.

        K. Takahashi, J. Fagan and M. Chen, Formation of a sparse bus impedance matrix and its application to short
        circuit study, 1973.
        """
        from omnisight.optim._multifrontal_kernel import copy_blocks

        found, inverses = self.pattern.zeros(), dict[int, Array]()
        children = np.bincount([front.parent + 1 for front in self.fronts], minlength=len(self.fronts) + 1)[1:]
        for f in range(len(self.fronts) - 1, -1, -1):
            front, factor = self.fronts[f], self.factors[f]
            count, dense = front.count, np.empty((len(front.columns),) * 2, order="F")
            own = np.tril(dpotri(factor[:count], lower=1)[0])
            dense[:count, :count] = own + np.tril(own, -1).T
            if front.parent >= 0:
                others = inverses[front.parent][np.ix_(front.in_parent, front.in_parent)]
                gain = dtrsm(1.0, factor[:count], factor[count:], side=1, lower=1)
                cross = dsymm(-1.0, others, gain)
                dense[count:, count:], dense[count:, :count], dense[:count, count:] = others, cross, cross.T
                dense[:count, :count] -= gain.T @ cross
                children[front.parent] -= 1
                if not children[front.parent]:
                    del inverses[front.parent]
            copy_blocks(found.values, self.pattern.offsets, *front.blocks, dense, False)
            if children[f]:
                inverses[f] = dense
        return found


def _elimination(pattern: BlockPattern) -> tuple[Indices, list[Indices]]:
    """Return the groups (B,) in the order of elimination, and the positions of the groups that each changes.

    The order is that of minimum degree (J. Liu, Modification of the minimum-degree algorithm by multiple elimination,
    1985), of SuperLU.
    """
    groups = len(pattern.sizes)
    if groups < 2:
        return np.zeros(groups, np.intp), [np.zeros(0, np.intp)] * groups
    off = pattern.row != pattern.column
    row, column = pattern.row[off], pattern.column[off]
    degree = np.bincount(row, minlength=groups) + np.bincount(column, minlength=groups)
    # Diagonally dominant, with positive pivots: no fill-in cancels, and no rows are exchanged.
    entries = np.concatenate([np.full(2 * len(row), -1.0), degree + 1.0])
    ends = np.concatenate([row, column, np.arange(groups)]), np.concatenate([column, row, np.arange(groups)])
    matrix = coo_array((entries, ends), shape=(groups, groups)).tocsc()
    factored = splu(matrix, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, relax=1, options={"SymmetricMode": True})
    lower = factored.L.tocsc()
    below = [np.sort(lower.indices[a:b]) for a, b in zip(lower.indptr, lower.indptr[1:], strict=False)]
    return np.argsort(factored.perm_c), [each[each > k].astype(np.intp) for k, each in enumerate(below)]


def _joined(sizes: Indices, below: Sequence[Indices]) -> list[tuple[int, int]]:
    """Return the first and the last position + 1 of the groups of each front.

    A front is joined to the next one, if that is its parent: all its other rows are then among those of the next.
    """
    fronts = list[tuple[int, int]]()
    entries = list[int]()  # of the columns of each front, without the zeros of joining
    for k in range(len(sizes)):
        height = int(sizes[k] + sizes[below[k]].sum())
        first, needed, width = k, height * int(sizes[k]), int(sizes[k])
        while fronts and len(others := below[first - 1]) and others[0] == first:
            before = fronts[-1][0]
            own = int(sizes[before:first].sum())
            rows = own + height + int(sizes[first:k].sum())
            stored = (own + width) * rows
            if stored > (1 + MAX_ZEROS) * (needed + entries[-1]) and own + width > FEW_COLUMNS:
                break
            first, width, needed = before, own + width, needed + entries.pop()
            fronts.pop()
        fronts.append((first, k + 1))
        entries.append(needed)
    return fronts


def _ranges(starts: Indices, sizes: Indices) -> Indices:
    """Return the concatenated ranges start ... start + size."""
    offsets = np.cumsum(sizes) - sizes
    return np.repeat(starts - offsets, sizes) + np.arange(int(sizes.sum()))
