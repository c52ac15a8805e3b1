"""Sparse symmetric matrices of dense blocks."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class BlockPattern:
    """Which blocks of a symmetric matrix are not zero.

    Attributes
    ----------
    starts
        (B + 1,) first column of each of B groups of columns.
    row, column
        (N,) groups of the rows and of the columns of the blocks, row >= column, sorted by row and column. Those of the
        diagonal are among them.
    """

    starts: Indices
    row: Indices
    column: Indices

    @classmethod
    def dense(cls, size: int) -> "BlockPattern":
        """Return the pattern of a matrix (C, C) without zeros: one block, or none if it has no columns."""
        groups = np.arange(1 if size else 0)
        return cls(np.append(0, groups + size), groups, groups)

    @classmethod
    def of_incidence(cls, starts: Indices, incidence: csr_array) -> "BlockPattern":
        """Return the pattern of J^T J, where the rows (R, B) of `incidence` are the groups that rows of J depend on."""
        ones = csr_array((np.ones(incidence.nnz, np.float32), incidence.indices, incidence.indptr), incidence.shape)
        groups = len(starts) - 1
        linked = (ones.T @ ones).tocoo()
        lower = linked.row > linked.col
        row = np.concatenate([linked.row[lower], np.arange(groups)])
        column = np.concatenate([linked.col[lower], np.arange(groups)])
        order = np.lexsort((column, row))
        return cls(starts, row[order].astype(np.intp), column[order].astype(np.intp))

    @property
    def size(self) -> int:
        """Number of columns."""
        return int(self.starts[-1])

    @cached_property
    def sizes(self) -> Indices:
        """Number of columns (B,) of each group."""
        return np.diff(self.starts)

    @cached_property
    def row_starts(self) -> Indices:
        """First block (B + 1,) of each row of blocks."""
        return np.searchsorted(self.row, np.arange(len(self.starts)))

    @cached_property
    def offsets(self) -> Indices:
        """First value (N + 1,) of each block; its values are in row-major order."""
        return np.concatenate([[0], np.cumsum(self.sizes[self.row] * self.sizes[self.column])])

    @cached_property
    def diagonal(self) -> Indices:
        """Where the values (C,) of the diagonal of a matrix are stored."""
        index = np.arange(self.size)
        return self.addresses(index, index)

    @cached_property
    def _keys(self) -> Indices:
        """Increasing numbers (N,) that identify the blocks."""
        return self.row * len(self.starts) + self.column

    def zeros(self) -> "BlockMatrix":
        """Return the matrix of zeros."""
        return BlockMatrix(self, np.zeros(int(self.offsets[-1])))

    def group_of(self, column: Indices) -> Indices:
        """Return the groups of columns; -1 for the column -1."""
        return np.searchsorted(self.starts, column, side="right") - 1

    def addresses(self, row: Indices, column: Indices) -> Indices:
        """Return where the values of a matrix at rows and columns of any shape are stored; -1 if the pattern has none.

        A row or column of -1 has no values.
        """
        if not len(self.row):
            return np.full(np.shape(row), -1)
        high, low = np.maximum(row, column), np.minimum(row, column)
        of_row, of_column = self.group_of(high), self.group_of(np.maximum(low, 0))
        key = of_row * len(self.starts) + of_column
        block = np.minimum(np.searchsorted(self._keys, key), len(self._keys) - 1)
        within = (high - self.starts[of_row]) * self.sizes[of_column] + low - self.starts[of_column]
        return np.where((low >= 0) & (self._keys[block] == key), self.offsets[block] + within, -1)


@dataclass(frozen=True, eq=False)
class BlockMatrix:
    """A symmetric matrix (C, C) whose blocks are known where a pattern has them.

    Attributes
    ----------
    pattern
        The pattern.
    values
        Values of all blocks, as by `BlockPattern.offsets`; of the blocks of the diagonal, the lower triangles.
    """

    pattern: BlockPattern
    values: Array

    def diagonal(self) -> Array:
        """Return the diagonal (C,)."""
        return self.values[self.pattern.diagonal]

    def add_diagonal(self, diagonal: Array) -> None:
        """Add a diagonal (C,) in place."""
        self.values[self.pattern.diagonal] += diagonal

    def at(self, row: Indices, column: Indices) -> Array:
        """Return the values at rows and columns of any shape; 0 outside of the pattern, or for -1."""
        return np.append(self.values, 0.0)[self.pattern.addresses(row, column)]

    def square(self, columns: Indices) -> Array:
        """Return the values (..., K, K) at columns (..., K); 0 outside of the pattern, or for -1."""
        return self.at(*np.broadcast_arrays(columns[..., :, None], columns[..., None, :]))

    def toarray(self) -> Array:
        """Return the matrix (C, C), with zeros outside of the pattern."""
        return self.square(np.arange(self.pattern.size))

    def __matmul__(self, x: Array) -> Array:
        """Return the product (C,) with a vector (C,); blocks outside of the pattern are zero."""
        from omnisight.optim._multifrontal_kernel import multiply_blocks

        pattern, product = self.pattern, np.zeros(len(x))
        multiply_blocks(self.values, pattern.offsets, pattern.row, pattern.column, pattern.starts, x, product)
        return product

    def scaled(self, scale: Array) -> "BlockMatrix":
        """Return the matrix with rows and columns multiplied by a scale (C,)."""
        from omnisight.optim._multifrontal_kernel import scale_blocks

        pattern, values = self.pattern, self.values.copy()
        scale_blocks(values, pattern.offsets, pattern.row, pattern.column, pattern.starts, scale)
        return BlockMatrix(pattern, values)
