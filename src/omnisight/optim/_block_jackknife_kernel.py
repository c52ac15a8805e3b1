"""Compiled jackknife that deletes one block of neighbouring observations at a time."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver, njit_helper
from omnisight.optim._eigen_kernel import pseudo_inverse
from omnisight.optim._normal_equations_kernel import add_observation


@njit_driver
def deletion_variance(residuals, jacobians, positions, halvings):
    """Return the variance of an estimate over that of independent residuals, the mean over all directions of a step.

    Parameters
    ----------
    residuals, jacobians
        (N, D) and (N, D, P), whose rows with NaN are left out.
    positions
        (N, K) vectors by whose distance observations are neighbours.
    halvings
        Number of halvings of the observations into blocks.
    """
    _, _, parameters = jacobians.shape
    order = np.flatnonzero(np.isfinite(residuals[:, 0]))
    starts = _halve(positions, order, halvings)
    blocks = len(starts) - 1
    gradients, informations = np.zeros((blocks, parameters)), np.zeros((blocks, parameters, parameters))
    for b in range(blocks):
        for i in order[starts[b] : starts[b + 1]]:
            add_observation(1.0, residuals[i], jacobians[i], gradients[b], informations[b])
        for r in range(parameters):
            for c in range(r):
                informations[b, c, r] = informations[b, r, c]
    information, total = np.zeros((parameters, parameters)), 0.0
    for b in range(blocks):
        information += informations[b]
    for b in range(blocks):
        # The change of the estimate without the block; what only this block determines does not change.
        change = pseudo_inverse(information - informations[b]) @ gradients[b]
        total += (change * (information @ change)).sum()
    return total * (1.0 - 1.0 / blocks) / parameters


@njit_helper
def _halve(positions, order, halvings):
    """Sort indices (M,) into 2^halvings blocks of neighbours, halved across the axis of the largest extent, in place.

    Returns
    -------
    starts
        (2^halvings + 1,) first index of each block.
    """
    starts = np.array([0, len(order)])
    for _ in range(halvings):
        halves = np.empty(2 * len(starts) - 1, np.int64)
        for b in range(len(starts) - 1):
            first, last = starts[b], starts[b + 1]
            block = order[first:last].copy()
            best, extent = 0, -1.0
            for k in range(positions.shape[1]):
                along = positions[block, k]
                if len(along) and along.max() - along.min() > extent:
                    best, extent = k, along.max() - along.min()
            for i, k in enumerate(np.argsort(positions[block, best])):
                order[first + i] = block[k]
            halves[2 * b], halves[2 * b + 1] = first, first + (last - first) // 2
        halves[-1] = len(order)
        starts = halves
    return starts
