"""Refinement of a model to the maximum likelihood under a mixture of Gaussian noise and outliers."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.optim.false_alarms import chance_probability

Array = NDArray[np.float64]

# Squared length of a residual over its variance that 99.7 % of the inliers do not exceed (3 sigma in one dimension), by
# the dimension of the residual.
THRESHOLDS = {1: 9.0, 2: 11.83}


class Refinement(NamedTuple):
    """A model of maximum likelihood.

    Attributes
    ----------
    model
        (3, 4).
    is_inlier
        (N,), whether each observation is more probably an inlier than an outlier.
    scale
        Standard deviation of the residuals in units of the assumed ones.
    covariance
        (P, P) covariance of a step of the model.
    evidence
        Logarithm of the likelihood of the observations over that of outliers only.
    """

    model: Array
    is_inlier: NDArray[np.bool_]
    scale: float
    covariance: Array
    evidence: float


def refine(problem: Any, model: Array, *, is_scale_known: bool = True, prior: Array | None = None) -> Refinement:
    """Refine a model to the maximum likelihood under a mixture of Gaussian noise and outliers.

    Parameters
    ----------
    problem
        A problem of `_robust_problem_kernel`, its observations in random order.
    model
        (3, 4), close to the solution.
    is_scale_known
        Whether the standard deviations of the observations are known, and not only up to a factor.
    prior
        (P, P) information of a Gaussian prior about the model.
    """
    from omnisight.optim._mixture_kernel import features, fit_mixture

    _, _, dimension, parameters = problem.sizes(problem)
    threshold = THRESHOLDS[dimension]
    chance = threshold, chance_probability(problem, model, threshold)
    prior = np.zeros((parameters, parameters)) if prior is None else prior
    values = features(problem, model)
    is_constant = values.min(initial=np.inf) == values.max(initial=-np.inf)
    similar = len(values) if is_constant else math.ceil(math.sqrt(len(values)))
    neighbours = np.argsort(values, kind="stable"), similar
    found = fit_mixture(problem, model, chance, is_scale_known, prior, neighbours)
    model, probability, scale, covariance, evidence = found
    return Refinement(model, np.asarray(probability > 0.5), float(scale), covariance, float(evidence))
