"""Compiled copies between a block matrix and the fronts of its elimination."""

# Compiled code takes its types from its arguments.
# pyright: basic

from omnisight.compiled import njit_driver, njit_helper


@njit_helper
def block_offset(row_starts, columns, offsets, row, column):
    """Return the first value of the block of two groups, row >= column, which the pattern must contain."""
    low, high = row_starts[row], row_starts[row + 1]
    while high - low > 1:
        middle = (low + high) // 2
        if columns[middle] <= column:
            low = middle
        else:
            high = middle
    return offsets[low]


@njit_driver
def copy_blocks(values, offsets, blocks, heights, widths, tops, lefts, front, to_front):
    """Copy blocks of a matrix to the lower triangle of a front (N, N), or back.

    Parameters
    ----------
    values, offsets
        Of the matrix.
    blocks, heights, widths
        (K,) indices of the blocks, and their sizes.
    tops, lefts
        (K,) rows of the front of the first row and of the first column of each block. Blocks above the diagonal are
        transposed; of those on it, the lower triangle is used.
    """
    for k in range(len(blocks)):
        source, is_diagonal = offsets[blocks[k]], tops[k] == lefts[k]
        for r in range(heights[k]):
            for c in range(r + 1 if is_diagonal else widths[k]):
                i, j = tops[k] + r, lefts[k] + c
                if i < j:
                    i, j = j, i
                if to_front:
                    front[i, j] = values[source + r * widths[k] + c]
                else:
                    values[source + r * widths[k] + c] = front[i, j]


@njit_driver
def extend_add(front, update, index):
    """Add the lower triangle of an update (K, K) to the rows and columns index (K,), increasing, of a front."""
    for c in range(len(index)):
        for r in range(c, len(index)):
            front[index[r], index[c]] += update[r, c]


@njit_driver
def scale_blocks(values, offsets, row, column, starts, scale):
    """Multiply the rows and columns of all blocks by a scale (C,), in place."""
    for k in range(len(row)):
        address = offsets[k]
        for i in range(starts[row[k]], starts[row[k] + 1]):
            for j in range(starts[column[k]], starts[column[k] + 1]):
                values[address] *= scale[i] * scale[j]
                address += 1
