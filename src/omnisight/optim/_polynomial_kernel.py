"""Compiled operations on polynomials with coefficients in ascending order."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_helper

MAX_STEPS = 60
# Width of a bracket in [-1, 1] that is a root.
ROOT_TOLERANCE = 4e-16


@njit_helper
def multiply_add(target, left, right, factor):
    """Add the product of two polynomials times a factor to a polynomial; return it."""
    for i in range(len(left)):
        for j in range(len(right)):
            if i + j < len(target):
                target[i + j] += factor * left[i] * right[j]
    return target


@njit_helper
def evaluate(coefficients, degree, x):
    """Return the value of a polynomial and of its derivative."""
    value, slope = coefficients[degree], 0.0
    for i in range(degree - 1, -1, -1):
        slope = slope * x + value
        value = value * x + coefficients[i]
    return value, slope


@njit_helper
def real_roots(coefficients, roots):
    """Compute the real roots of a polynomial; return their number.

    Roots outside [-1, 1] are the inverse roots of the polynomial with reversed coefficients. Double roots, which
    rounding moves off the real axis, may not be found.
    """
    scaled = coefficients / np.abs(coefficients).max()
    count = _roots_in_unit_interval(scaled, roots)
    inverse = np.empty(len(roots))
    for k in range(_roots_in_unit_interval(scaled[::-1].copy(), inverse)):
        if ROOT_TOLERANCE < abs(inverse[k]) < 1.0 and count < len(roots):  # the others are infinite
            roots[count] = 1.0 / inverse[k]
            count += 1
    return count


@njit_helper
def _roots_in_unit_interval(coefficients, roots):
    """Compute the roots in [-1, 1] in ascending order; return their number.

    Between two roots of its derivative a polynomial is monotonic and has at most one root, which a Newton iteration
    with bisection finds. The roots of the derivatives follow from those of higher derivatives.
    """
    degree = len(coefficients) - 1
    derivative, stationary = np.empty(degree + 1), np.empty(degree + 2)
    count = 0
    for order in range(1, degree + 1):  # the derivative of degree `order`
        for i in range(order + 1):
            factor = 1.0
            for k in range(degree - order):
                factor *= i + degree - order - k
            derivative[i] = factor * coefficients[i + degree - order]
        for k in range(count, 0, -1):
            stationary[k] = roots[k - 1]
        stationary[0], stationary[count + 1] = -1.0, 1.0
        found = 0
        for k in range(count + 1):
            root, is_root = _bracketed_root(derivative, order, stationary[k], stationary[k + 1])
            if is_root:
                roots[found] = root
                found += 1
        count = found
    return count


@njit_helper
def _bracketed_root(coefficients, degree, low, high):
    """Return the root between two bounds, and whether there is one."""
    at_low, _ = evaluate(coefficients, degree, low)
    at_high, _ = evaluate(coefficients, degree, high)
    if at_low == 0.0:
        return low, True
    if (at_low > 0.0) == (at_high > 0.0):
        return 0.0, False
    x = 0.5 * (low + high)
    for _ in range(MAX_STEPS):
        value, slope = evaluate(coefficients, degree, x)
        if (value > 0.0) == (at_low > 0.0):
            low = x
        else:
            high = x
        step = value / slope if slope != 0.0 else np.inf
        following = x - step
        if not low < following < high:
            following = 0.5 * (low + high)
        if abs(following - x) <= ROOT_TOLERANCE or value == 0.0:
            return following if value != 0.0 else x, True
        x = following
    return x, True
