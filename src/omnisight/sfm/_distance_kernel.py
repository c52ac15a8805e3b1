"""Compiled loops over the distances of the keypoints of all images from the points of edges."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver


@njit_driver
def reweight(starts, edge, values, sigma, scales, weights):
    """Update the weights (D,) of the least sum of |residual| / sigma, from the residuals with the given weights.

    The residual of a distance is its difference from the weighted mean of those of the same keypoint.

    Parameters
    ----------
    starts
        (K + 1,) first distance of each keypoint.
    edge, values, sigma
        (D,) edges, logarithms of the distances, and their standard deviations.
    scales
        (E,) logarithms of the scales of the edges.
    weights
        (D,), which are changed.
    """
    for k in range(len(starts) - 1):
        total, mean = 0.0, 0.0
        for i in range(starts[k], starts[k + 1]):
            total += weights[i]
            mean += weights[i] * (values[i] + scales[edge[i]])
        for i in range(starts[k], starts[k + 1]):
            residual = abs(values[i] + scales[edge[i]] - mean / total) / sigma[i]
            weights[i] = 1.0 / (sigma[i] ** 2 * max(residual, 1.0))


@njit_driver
def fill_deviations(starts, edge, values, weights, deviations):
    """Fill the sum (E,) of the weighted differences of the means of keypoints from the values of each edge."""
    deviations[:] = 0.0
    for k in range(len(starts) - 1):
        total, mean = 0.0, 0.0
        for i in range(starts[k], starts[k + 1]):
            total += weights[i]
            mean += weights[i] * values[i]
        for i in range(starts[k], starts[k + 1]):
            deviations[edge[i]] += weights[i] * (mean / total - values[i])


@njit_driver
def fill_medians(starts, edge, values, scales, medians):
    """Fill the median logarithm (K,) of the distances of each keypoint; NaN without any from edges of known scale."""
    longest = 0
    for k in range(len(starts) - 1):
        longest = max(longest, starts[k + 1] - starts[k])
    known = np.empty(longest)
    for k in range(len(starts) - 1):
        count = 0
        for i in range(starts[k], starts[k + 1]):
            value = values[i] + scales[edge[i]]
            if np.isnan(value):
                continue
            place = count
            while place > 0 and known[place - 1] > value:
                known[place] = known[place - 1]
                place -= 1
            known[place] = value
            count += 1
        medians[k] = known[count // 2] if count else np.nan
