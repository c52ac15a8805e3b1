"""Compiled operations on polynomials with coefficients in ascending order."""

# Compiled code takes its types from its arguments.
# pyright: basic

from math import comb

import numpy as np

from omnisight.compiled import njit_helper

MAX_STEPS = 60
# Width of a bracket in [0, 1] that is a root.
ROOT_TOLERANCE = 4e-16
# Halley step after which a root is exact to rounding, since the error is about the third power of the step.
HALLEY_TOLERANCE = 1e-7
# A double root is not resolved beyond the square root of the rounding.
MAX_DIVISIONS = 30
SHORTEST = 0.5**MAX_DIVISIONS
# Every polynomial is written in the Bernstein basis of this degree, so that one matrix serves for all.
DEGREE = 10
SIZE = DEGREE + 1
# Columns of the bounds of a segment, after its coefficients.
LOW, HIGH = SIZE, SIZE + 1
# Coefficients in the Bernstein basis from those of the powers: C(i, j)/C(n, j).
BERNSTEIN = np.array([[comb(i, j) / comb(DEGREE, j) for j in range(SIZE)] for i in range(SIZE)])


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
    """Return the value of a polynomial, of its derivative, and half of that of its second derivative."""
    value, slope, curvature = coefficients[degree], 0.0, 0.0
    for i in range(degree - 1, -1, -1):
        curvature = curvature * x + slope
        slope = slope * x + value
        value = value * x + coefficients[i]
    return value, slope, curvature


@njit_helper
def real_roots(coefficients, roots):
    """Compute the simple real roots of a polynomial of degree 10 at most; return their number.

    On [0, 1], the coefficients in the Bernstein basis have no sign change if there is no root, and one if there is one;
    otherwise the interval is divided (A. Eigenwillig, Real root isolation, 2008). The other roots are those of the
    polynomials in -x, 1/x and -1/x. Double roots, which rounding moves off the real axis, may not be found.
    """
    size, largest = len(coefficients), 0.0
    for i in range(size):
        if not abs(coefficients[i]) < np.inf:
            return 0
        largest = max(abs(coefficients[i]), largest)
    if largest == 0.0:
        return 0
    work = np.empty((MAX_DIVISIONS + 4, SIZE + 2))  # one array, because each takes time
    variant, unit_roots, pending = work[0], work[1], work[2:]
    variant[:] = 0.0
    count = 0
    for k in range(4):
        is_negative, is_inverse = k % 2 == 1, k >= 2
        for i in range(size):
            variant[i] = coefficients[size - 1 - i if is_inverse else i] / largest
            if is_negative and i % 2 == 1:
                variant[i] = -variant[i]
        for n in range(_roots_in_unit_interval(variant, unit_roots, pending)):
            x = unit_roots[n]
            # Roots at 0, 1 and -1 belong to two intervals; those beyond 1/ROOT_TOLERANCE are infinite.
            is_counted = ROOT_TOLERANCE < x < 1.0 if is_inverse else not (is_negative and x == 0.0)
            if is_counted and count < len(roots):
                roots[count] = 1.0 / x if is_inverse else x
                if is_negative:
                    roots[count] = -roots[count]
                count += 1
    return count


@njit_helper
def _roots_in_unit_interval(coefficients, roots, pending):
    """Compute the simple roots in [0, 1]; return their number.

    The segments to do overwrite the last array: their coefficients and bounds.
    """
    for i in range(SIZE):
        pending[0, i] = 0.0
        for j in range(i + 1):
            pending[0, i] += BERNSTEIN[i, j] * coefficients[j]
    pending[0, LOW], pending[0, HIGH] = 0.0, 1.0
    count, top = 0, 0
    if pending[0, DEGREE] == 0.0:
        roots[0], count = 1.0, 1
    while top >= 0 and count < SIZE:
        segment, low, high = pending[top], pending[top, LOW], pending[top, HIGH]
        changes = _sign_changes(segment)
        if segment[0] == 0.0:
            roots[count] = low
            count += 1
        if changes == 1 and count < SIZE:
            roots[count] = _bracketed_root(coefficients, segment, low, high)
            count += 1
        if changes > 1 and high - low > SHORTEST:
            _divide(segment, pending[top + 1])
            middle = 0.5 * (low + high)
            pending[top, LOW] = pending[top + 1, HIGH] = middle
            pending[top + 1, LOW] = low
            top += 1
        else:
            top -= 1
    return count


@njit_helper
def _sign_changes(segment):
    """Return the number of sign changes of the coefficients of a segment, without zeros."""
    changes = 0
    last = 0.0
    for i in range(SIZE):
        value = segment[i]
        changes += ((value > 0.0) & (last < 0.0)) | ((value < 0.0) & (last > 0.0))
        last = value if value != 0.0 else last
    return changes


@njit_helper
def _divide(segment, left):
    """Divide a segment in the Bernstein basis at its middle by de Casteljau's algorithm; it becomes the right half."""
    for i in range(SIZE):
        left[i] = segment[0]
        for j in range(DEGREE - i):
            segment[j] = 0.5 * (segment[j] + segment[j + 1])


@njit_helper
def _bracketed_root(coefficients, segment, low, high):
    """Return the only root between two bounds by Halley's method with bisection.

    It starts where the polygon of the Bernstein coefficients of the segment crosses zero.
    """
    last = 0
    while segment[last] == 0.0:
        last += 1
    is_positive_at_low = segment[last] > 0.0
    while segment[last + 1] == 0.0 or (segment[last + 1] > 0.0) == is_positive_at_low:
        last += 1
    crossing = (last + segment[last] / (segment[last] - segment[last + 1])) / DEGREE
    x = low + crossing * (high - low)
    for _ in range(MAX_STEPS):
        value, slope, curvature = evaluate(coefficients, DEGREE, x)
        if value == 0.0:
            break
        if (value > 0.0) == is_positive_at_low:
            low = x
        else:
            high = x
        following = x - value * slope / (slope * slope - value * curvature)
        is_halley = low < following < high
        if not is_halley:
            following = 0.5 * (low + high)
        if abs(following - x) <= (HALLEY_TOLERANCE if is_halley else ROOT_TOLERANCE):
            return following
        x = following
    return x
