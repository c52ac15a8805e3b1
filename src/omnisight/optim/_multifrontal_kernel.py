"""Compiled copies between a block matrix and the fronts of its elimination."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

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
def multiply_blocks(values, offsets, row, column, starts, x, product):
    """Add the product with a vector x (C,) to `product` (C,), in place."""
    for k in range(len(row)):
        address, is_diagonal = offsets[k], row[k] == column[k]
        first, last = starts[column[k]], starts[column[k] + 1]
        for i in range(starts[row[k]], starts[row[k] + 1]):
            total = 0.0
            for j in range(first, i if is_diagonal else last):
                value = values[address + j - first]
                total += value * x[j]
                product[j] += value * x[i]
            if is_diagonal:
                total += values[address + i - first] * x[i]
            product[i] += total
            address += last - first


@njit_driver
def scale_blocks(values, offsets, row, column, starts, scale):
    """Multiply the rows and columns of all blocks by a scale (C,), in place."""
    for k in range(len(row)):
        address = offsets[k]
        for i in range(starts[row[k]], starts[row[k] + 1]):
            for j in range(starts[column[k]], starts[column[k] + 1]):
                values[address] *= scale[i] * scale[j]
                address += 1


@njit_driver
def add_deviations(values, row_starts, columns, starts, member, weights, unknown_starts, of_unknown, set_of):
    """Add the normal matrix of the deviations of unknowns from their weighted mean in each set, in place.

    A set with weights w has the matrix diag(w) - w w^T / sum(w).

    Parameters
    ----------
    values, row_starts, columns
        Of a matrix whose groups have one column each.
    starts
        (S + 1,) first member of each set.
    member, weights
        (M,) unknowns of the members, increasing in each set, and their weights.
    unknown_starts, of_unknown
        First entry (U + 1,) of each unknown in the indices (M,) of its members.
    set_of
        (M,) set of each member.
    """
    totals, row = np.zeros(len(starts) - 1), np.zeros(len(unknown_starts) - 1)
    for k in range(len(totals)):
        for i in range(starts[k], starts[k + 1]):
            totals[k] += weights[i]
    for unknown in range(len(row)):
        for i in of_unknown[unknown_starts[unknown] : unknown_starts[unknown + 1]]:
            k = set_of[i]
            share = weights[i] / totals[k]
            for j in range(starts[k], i + 1):
                row[member[j]] -= share * weights[j]
            row[unknown] += weights[i]
        for block in range(row_starts[unknown], row_starts[unknown + 1]):
            values[block] += row[columns[block]]
            row[columns[block]] = 0.0
