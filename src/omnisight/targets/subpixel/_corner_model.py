"""Model of the gray levels around a corner, with its derivatives: the compiled part of `corner_fit`.

The model of the gray levels around a corner is

    level + slope_u x + slope_v y + amplitude * blurred_product_of_signs(x, y),

x and y relative to the corner. Parameters, by the indices below: the light (level and slopes), the amplitude, the
directions of both edges, the logarithm of the blur, and the corner relative to the pixel nearest to its start. The
corner is last: its covariance then follows from the last 2x2 block of the normal matrix's Cholesky factor.
"""

# Compiled code takes its types from its arguments.
# pyright: basic

import math

from omnisight.compiled import njit_helper

LEVEL, SLOPE_U, SLOPE_V, AMPLITUDE, ANGLE_0, ANGLE_1, LOG_BLUR, U, V = range(9)
NUM_PARAMETERS = 9


@njit_helper
def edge_geometry(theta):
    """Return cosine and sine of both directions, the blur, and the cosine of the angle between the edges."""
    c0, s0 = math.cos(theta[ANGLE_0]), math.sin(theta[ANGLE_0])
    c1, s1 = math.cos(theta[ANGLE_1]), math.sin(theta[ANGLE_1])
    return c0, s0, c1, s1, math.exp(theta[LOG_BLUR]), c0 * c1 + s0 * s1


@njit_helper
def corner_pattern(x, y, edges, bend):
    """Return the blurred product of both signs, its derivatives by the distances across, those, and those along.

    Distances a, b across the edges are in standard deviations of the blur. For perpendicular edges the pattern is
    erf(a / sqrt 2) erf(b / sqrt 2). Otherwise the blurs across both edges correlate by r, which adds
    4 int_0^r density(a, b; q) dq (R. L. Plackett, A reduction formula for normal multivariate integrals, Biometrika
    1954), here by the midpoint rule.
    """
    c0, s0, c1, s1, blur, r = edges
    along0, along1 = c0 * x + s0 * y, c1 * x + s1 * y
    a = (c0 * y - s0 * x - bend[0] * along0 * along0) / blur
    b = (c1 * y - s1 * x - bend[1] * along1 * along1) / blur
    sign0, slope0 = blurred_sign(a)
    sign1, slope1 = blurred_sign(b)
    pattern, d0, d1 = sign0 * sign1, slope0 * sign1, slope1 * sign0
    if slope0 != 0.0 and slope1 != 0.0:
        q = r / 2
        rest = 1 - q * q
        bump = 2 * r / (math.pi * math.sqrt(rest)) * math.exp(-(a * a - 2 * q * a * b + b * b) / (2 * rest))
        pattern += bump
        d0 -= bump * (a - q * b) / rest
        d1 -= bump * (b - q * a) / rest
    return pattern, d0, d1, a, b, along0, along1


@njit_helper
def blurred_sign(t):
    """Return erf(t / sqrt 2) and its derivative; beyond four standard deviations, the sign and 0."""
    if t > 4.0:
        return 1.0, 0.0
    if t < -4.0:
        return -1.0, 0.0
    return math.erf(t * math.sqrt(0.5)), math.sqrt(2 / math.pi) * math.exp(-0.5 * t * t)


@njit_helper
def initialize_light(theta, bend, window, count):
    """Set level and amplitude by linear regression on the pattern, slopes to 0; return the variation about the mean."""
    edges = edge_geometry(theta)
    mean = pattern = product = square = power = 0.0
    for i in range(count):
        value = window.values[i]
        m = corner_pattern(window.x[i] - theta[U], window.y[i] - theta[V], edges, bend)[0]
        mean += value
        pattern += m
        product += m * value
        square += m * m
        power += value * value
    mean, pattern = mean / count, pattern / count
    theta[AMPLITUDE] = (product / count - mean * pattern) / max(square / count - pattern * pattern, 1e-9)
    theta[LEVEL], theta[SLOPE_U], theta[SLOPE_V] = mean - theta[AMPLITUDE] * pattern, 0.0, 0.0
    return power - count * mean * mean


@njit_helper
def evaluate(x, y, theta, edges, bend, row):
    """Return the model at a pixel and set its derivatives (9,)."""
    c0, s0, c1, s1, blur, _ = edges
    pattern, d0, d1, a, b, along0, along1 = corner_pattern(x, y, edges, bend)
    d0, d1 = theta[AMPLITUDE] * d0, theta[AMPLITUDE] * d1
    row[LEVEL], row[SLOPE_U], row[SLOPE_V], row[AMPLITUDE] = 1.0, x, y, pattern
    row[ANGLE_0], row[ANGLE_1] = -d0 * along0 / blur, -d1 * along1 / blur
    row[LOG_BLUR] = -d0 * a - d1 * b
    row[U] = (d0 * s0 + d1 * s1) / blur - theta[SLOPE_U]
    row[V] = -(d0 * c0 + d1 * c1) / blur - theta[SLOPE_V]
    return theta[LEVEL] + theta[SLOPE_U] * x + theta[SLOPE_V] * y + theta[AMPLITUDE] * pattern
