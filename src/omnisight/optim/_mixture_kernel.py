"""Compiled maximum likelihood with outliers: residuals are a mixture of a Gaussian and outliers of known density."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver, njit_helper
from omnisight.optim._eigen_kernel import matrix_of, pseudo_inverse, symmetric_eigen
from omnisight.optim._normal_equations_kernel import add_observation
from omnisight.optim._robust_problem_kernel import feature, linearize, outlier_density, retract, sizes

# Rounds of expectation and maximization. They end when a step, in units of its standard deviation, is below the
# tolerance, and the scale changes by less than this fraction. An error of a hundredth of the standard deviation adds
# 0.01 % to the variance.
MAX_ROUNDS, TOLERANCE = 50, 1e-2
# Smallest scale of the noise: residuals of exact correspondences are rounding.
MIN_SCALE = 1e-6
# Smallest part of a residual that remains in the fit, relative to that of the model of the others.
MIN_REST = 1e-6
# Smallest information of a step, relative to the largest one.
MIN_INFORMATION = 1e-12
# Smallest standard deviation of a residual by the model, relative to its own, for derivatives by differences.
MIN_SPREAD = 1e-3
# Largest assumed probability that an outlier is consistent by chance. Where all are, the inconsistent ones do not tell
# how many outliers there are.
MAX_CHANCE = 0.5
# Inliers and outliers that are added to all observations, so that no share is 0 or 1.
PSEUDO_COUNT = 0.5


@njit_driver
def features(problem, model):
    """Return a feature (N,) of each observation: those with a similar one are as often outliers."""
    values = np.empty(len(problem[0]))
    for i in range(len(values)):
        values[i] = feature(problem, model, i)
    return values


@njit_driver
def fit_mixture(problem, model, chance, is_scale_known, prior, neighbours):
    """Estimate a model, and the scale of its residuals unless it is known, by expectation maximization.

    Each round takes one Gauss-Newton step (A. Dempster, N. Laird, D. Rubin, Maximum likelihood from incomplete data via
    the EM algorithm, 1977). Whether an observation is an inlier follows from its residual to the model of the others:
    a model fits an outlier that determines it.

    Parameters
    ----------
    problem
        A problem of `_robust_problem_kernel`.
    model
        (3, 4), close to the solution.
    chance
        Largest squared residual of an observation that is consistent with a model, and the probability that unrelated
        parts of observations are.
    is_scale_known
        Whether the standard deviation of the inliers' residuals is 1.
    prior
        (P, P) information of a Gaussian prior about the given model; zero for none.
    neighbours
        Order (N,) of the `features`, and the number of observations before and after one that are similar to it.

    Returns
    -------
    model
        (3, 4).
    probability
        (N,), that each observation is an inlier.
    scale
        Standard deviation of the inliers' residuals.
    covariance
        (P, P) of a step, the inverse of the observed information: what is unknown about which observations are inliers
        is subtracted (T. Louis, Finding the observed information matrix when using the EM algorithm, 1982). It is the
        mean over the posterior (M. Opper and C. Archambeau, The variational Gaussian approximation revisited, 2009): at
        the maximum it can be negative, where this is unknown of an observation with a large leverage.
    evidence
        Logarithm of the likelihood of the residuals over that of unrelated parts only, plus that of the prior up to a
        constant.
    """
    _, _, dimension, parameters = sizes(problem)
    count, model, scale = len(problem[0]), model.copy(), 1.0
    threshold, probability_of_chance = chance
    volume = 2.0 * np.sqrt(threshold) if dimension == 1 else np.pi * threshold
    measured = probability_of_chance / volume
    residuals, jacobians = np.empty((count, dimension)), np.empty((count, dimension, parameters))
    squares, probability = np.empty(count), np.zeros(count)
    share, density = np.empty(count), np.empty(count)
    gradient, information = np.empty(parameters), np.empty((parameters, parameters))
    leverage, normalized, variance = np.zeros(count), np.empty(count), np.empty(count)
    offset = np.zeros(parameters)
    _linearize_all(problem, model, residuals, jacobians, squares)
    is_converged = False
    for k in range(MAX_ROUNDS + 1):
        _leave_out(squares, leverage, probability, scale, normalized, variance)
        _fill_density(problem, model, scale, measured, density)
        _fill_share(neighbours, normalized, threshold, volume, density, share)
        _fill_probability(normalized, variance, dimension, (share, density), probability)
        if is_converged or k == MAX_ROUNDS:
            break
        _fill_normal_equations(residuals, jacobians, probability, gradient, information)
        information += prior
        covariance = pseudo_inverse(information)
        _fill_leverage(problem, jacobians, squares, covariance, leverage)
        step = -covariance @ (gradient + prior @ offset)
        retract(problem, model, step)
        offset += step
        _linearize_all(problem, model, residuals, jacobians, squares)
        before = scale
        if not is_scale_known:
            scale = _scale(squares, dimension, probability, parameters)
        is_small_step = (step * (information @ step)).sum() <= (TOLERANCE * scale) ** 2
        is_converged = is_small_step and abs(scale - before) <= TOLERANCE * before
    evidence = _evidence(squares, dimension, scale, (share, measured)) - 0.5 * offset @ prior @ offset
    _fill_normal_equations(residuals, jacobians, probability / scale**2, gradient, information)
    covariance, known, found = _covariance(information + prior), np.empty(count), np.empty_like(information)
    for _ in range(MAX_ROUNDS):
        _fill_leverage(problem, jacobians, squares, covariance, leverage)
        _fill_known(normalized * variance, leverage, (dimension, scale), (share, density), known)
        _fill_normal_equations(residuals, jacobians, known, gradient, found)
        change = (covariance * (found - information)).sum()
        information += (found - information) / (1.0 + abs(change))  # remains positive
        covariance = _covariance(information + prior)
        if abs(change) < TOLERANCE:
            break
    return model, probability, scale, covariance, evidence


@njit_helper
def _linearize_all(problem, model, residuals, jacobians, squares):
    """Fill residuals (N, D), derivatives (N, D, P) and squared lengths (N,), inf where impossible."""
    for i in range(len(squares)):
        if linearize(problem, model, i, residuals[i], jacobians[i]):
            squares[i] = (residuals[i] ** 2).sum()
        else:
            squares[i] = np.inf


@njit_helper
def _fill_leverage(problem, jacobians, squares, covariance, leverage):
    """Fill the variance J C J^T (N,) of residuals that is due to the model, mean over their components."""
    _, _, dimension, parameters = sizes(problem)
    for i in range(len(leverage)):
        leverage[i] = 0.0
        if np.isfinite(squares[i]):
            for d in range(dimension):
                for r in range(parameters):
                    product = 0.5 * covariance[r, r] * jacobians[i, d, r]
                    for c in range(r):
                        product += covariance[r, c] * jacobians[i, d, c]
                    leverage[i] += 2.0 * product * jacobians[i, d, r] / dimension


@njit_helper
def _fill_density(problem, model, scale, measured, density):
    """Fill the density (N,) of the residual of an outlier near zero."""
    for i in range(len(density)):
        density[i] = outlier_density(problem, model, i, scale, measured)


@njit_helper
def _leave_out(squares, leverage, probability, scale, normalized, variance):
    """Fill the variance (N,) of the residual to the model of the other observations, and its squared length over it.

    With the probability p in the fit and the leverage h, that residual is r/(1 - p h), and its variance
    1 + h/(1 - p h).
    """
    for i in range(len(squares)):
        rest = max(1.0 - probability[i] * leverage[i], MIN_REST)
        variance[i] = scale**2 * (1.0 + leverage[i] / rest)
        normalized[i] = squares[i] / (rest**2 * variance[i])


@njit_helper
def _fill_probability(normalized, variance, dimension, outliers, probability):
    """Fill the posterior probability (N,) of the Gaussian component."""
    share, density = outliers
    for i in range(len(probability)):
        inlier = (1.0 - share[i]) * _gaussian(normalized[i], dimension) / np.sqrt(variance[i]) ** dimension
        probability[i] = inlier / (inlier + share[i] * density[i])


@njit_helper
def _fill_known(squares, leverage, noise, outliers, known):
    """Fill the mean information (N,) of residuals over the posterior of the model, from their variances `leverage`.

    It is the derivative of the score p r/sigma^2, p being the probability that an observation with the residual r to
    the model of the others is an inlier: along r the difference between one standard deviation more and less, and the
    mean across r.
    """
    (dimension, scale), (share, density) = noise, outliers
    for i in range(len(known)):
        known[i] = 0.0
        if not np.isfinite(squares[i]):
            continue
        spread, length = max(np.sqrt(leverage[i]) / scale, MIN_SPREAD), np.sqrt(squares[i]) / scale
        ratio, near, far = share[i] * density[i] * scale**dimension, length - spread, length + spread
        inlier = (1.0 - share[i]) * _gaussian(near**2, dimension), (1.0 - share[i]) * _gaussian(far**2, dimension)
        less, more = inlier[0] / (inlier[0] + ratio), inlier[1] / (inlier[1] + ratio)
        along, across = (more * far - less * near) / (2.0 * spread), (less + more) / 2.0
        known[i] = (along + (dimension - 1) * across) / (dimension * scale**2)


@njit_helper
def _evidence(squares, dimension, scale, outliers):
    (share, density), total = outliers, 0.0
    for i in range(len(squares)):
        inlier = _gaussian(squares[i] / scale**2, dimension) / scale**dimension
        total += np.log((1.0 - share[i]) * inlier / density + share[i])
    return total


@njit_helper
def _gaussian(square, dimension):
    """Return the density of the standard normal distribution at a squared distance from its mean."""
    return np.exp(-0.5 * square) / np.sqrt(2.0 * np.pi) ** dimension


@njit_helper
def _fill_share(neighbours, squares, threshold, volume, density, share):
    """Fill the share of outliers (N,) among the other observations with a similar feature.

    It follows from the number of inconsistent ones, and from the probability that an outlier is consistent by chance:
    its density times the volume of consistent residuals.
    """
    count, (order, half) = len(squares), neighbours
    pseudo_count = PSEUDO_COUNT * min(2.0 * half + 1.0, count) / count
    total = np.zeros(count + 1)
    for k in range(count):
        total[k + 1] = total[k] + (squares[order[k]] > threshold)
    for k in range(count):
        i, first, last = order[k], max(k - half, 0), min(k + half + 1, count)
        others = last - first - 1.0
        inconsistent = total[last] - total[first] - (squares[i] > threshold)
        found = (inconsistent + pseudo_count) / (others + 2.0 * pseudo_count)
        share[i] = min(found / (1.0 - min(volume * density[i], MAX_CHANCE)), 1.0)


@njit_helper
def _fill_normal_equations(residuals, jacobians, weights, gradient, information):
    """Fill the gradient (P,) and J^T W J (P, P) of weighted residuals."""
    gradient[:] = 0.0
    information[:] = 0.0
    for i in range(len(weights)):
        if weights[i] != 0.0:
            add_observation(weights[i], residuals[i], jacobians[i], gradient, information)
    for r in range(len(gradient)):
        for c in range(r):
            information[c, r] = information[r, c]


@njit_helper
def _scale(squares, dimension, probability, parameters):
    """Return the standard deviation of the residuals of inliers, corrected for the fitted parameters."""
    total = 0.0
    for i in range(len(squares)):
        if np.isfinite(squares[i]):  # a step can make an inlier impossible
            total += probability[i] * squares[i]
    freedom = dimension * probability.sum() - parameters
    return max(np.sqrt(total / max(freedom, 1.0)), MIN_SCALE)


@njit_helper
def _covariance(information):
    """Return the inverse of an observed information (P, P), whose eigenvalues are not always positive.

    An unobservable step has a huge variance, not zero as in a pseudo-inverse.
    """
    size = len(information)
    values, vectors = np.empty(size), np.empty((size, size))
    symmetric_eigen(information.copy(), values, vectors)
    least = max(values[size - 1] * MIN_INFORMATION, np.finfo(np.float64).tiny)
    for k in range(size):
        values[k] = 1.0 / max(values[k], least)
    return matrix_of(values, vectors)
