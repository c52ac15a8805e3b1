"""The methods of a problem of robust estimation, written by the problem and resolved by numba at compile time.

A problem is a `NamedTuple` of arrays (N, ...), one row per observation, with the static methods below; `feature` and
`outlier_density` have a default. A model is an array (3, 4). The residual of an observation has D components, and a
step of a model P. An observation may be a correspondence, with a first and a second part, such as the bearings of one
point in two images.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

import inspect
from typing import Any

import numpy as np
from numba.extending import overload

from omnisight.compiled import NJIT_OPTIONS, njit_driver


def sizes(problem) -> Any:
    """Return the size K of a minimal sample, the largest number S of its models, D and P."""
    raise NotImplementedError


def solve_minimal(problem, sample, models):
    """Fill models (S, 3, 4) from the observations with indices sample (K,); return how many there are."""
    raise NotImplementedError


def squared_error(problem, model, i, j):
    """Return the squared residual over its variance of the first part of observation i with the second part of j.

    The variance may be an approximation; the result is inf where the model makes the correspondence impossible.
    """
    raise NotImplementedError


def linearize(problem, model, i, residual, jacobian):
    """Fill the residual (D,) of an observation over its standard deviations, and its derivatives (D, P) by a step.

    Returns False where the model makes the correspondence impossible.
    """
    raise NotImplementedError


def feature(problem, model, i):
    """Return a quantity on which the share of outliers depends; constant if it is the same for all observations."""
    return 0.0


def outlier_density(problem, model, i, scale, measured):
    """Return the density of the residual of an outlier near zero, given what else is known of the observation.

    `scale` is the standard deviation of the residuals of inliers, and `measured` the mean density of those of unrelated
    parts of observations.
    """
    return measured


def retract(problem, model, step):
    """Move a model in place by a step (P,)."""
    raise NotImplementedError


def _defined_by_the_problem(method):
    def resolve(problem, *_):
        return getattr(problem.instance_class, method.__name__, method)

    resolve.__signature__ = inspect.signature(method)
    overload(method, jit_options=NJIT_OPTIONS | {"forceinline": True})(resolve)


for _method in (sizes, solve_minimal, squared_error, linearize, feature, outlier_density, retract):
    _defined_by_the_problem(_method)


@njit_driver
def squared_errors(problem, model):
    """Return the squared errors (N,) of all observations."""
    squares = np.empty(len(problem[0]))
    for i in range(len(squares)):
        squares[i] = squared_error(problem, model, i, i)
    return squares


@njit_driver
def squared_residuals(problem, model):
    """Return the squared lengths (N,) of all residuals over their exact variances; inf where impossible."""
    _, _, dimension, parameters = sizes(problem)
    squares, residual, jacobian = np.empty(len(problem[0])), np.empty(dimension), np.empty((dimension, parameters))
    for i in range(len(squares)):
        is_possible = linearize(problem, model, i, residual, jacobian)
        squares[i] = (residual**2).sum() if is_possible else np.inf
    return squares


@njit_driver
def linearized(problem, model):
    """Return the residuals (N, D), NaN where impossible, and their derivatives (N, D, P)."""
    _, _, dimension, parameters = sizes(problem)
    count = len(problem[0])
    residuals, jacobians = np.empty((count, dimension)), np.zeros((count, dimension, parameters))
    for i in range(count):
        if not linearize(problem, model, i, residuals[i], jacobians[i]):
            residuals[i] = np.nan
    return residuals, jacobians


@njit_driver
def count_consistent(problem, model, threshold, shifts):
    """Return the number of first parts that agree with the second part `shift` rows later, over all shifts.

    They agree if their squared error is at most a threshold.
    """
    count, hits = len(problem[0]), 0
    for shift in shifts:
        for i in range(count):
            hits += squared_error(problem, model, i, (i + shift) % count) <= threshold
    return hits


@njit_driver
def moved(problem, model, step):
    """Return a model moved by a step (P,)."""
    model = model.copy()
    retract(problem, model, step)
    return model
