"""Compiled part of `seams`: the path of least cost by dynamic programming."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver


@njit_driver
def least_path(cost, max_step, start, path):
    """Write the row of each column (C,) of the path of least cost from left to right.

    Parameters
    ----------
    cost : (R, C) array
        Cost of each pixel.
    max_step : int
        Rows that the path can move per column; oblique steps are longer, and cost half a pixel more per row.
    start : int
        Row of the first column, next to which the path ends; -1 for any.
    """
    rows, columns = cost.shape
    came = np.zeros((columns, rows), np.int8)
    total, extended = np.empty(rows), np.empty(rows)
    for row in range(rows):
        total[row] = cost[row, 0] if start < 0 or row == start else np.inf
    for column in range(1, columns):
        for row in range(rows):
            extended[row] = np.inf
            for step in range(max(-max_step, -row), min(max_step, rows - 1 - row) + 1):
                value = total[row + step] + 0.5 * abs(step) * cost[row, column]
                if value < extended[row]:
                    extended[row], came[column, row] = value, step
            extended[row] += cost[row, column]
        total, extended = extended, total
    low, high = (0, rows) if start < 0 else (max(0, start - max_step), min(rows, start + max_step + 1))
    row = low + np.argmin(total[low:high])
    for column in range(columns - 1, -1, -1):
        path[column] = row
        row += came[column, row]
