"""Uniform cubic B-splines of one and of two variables.

The four control values around a position 0 <= f <= 1 of a span have the weights (1 - f)^3/6, 2/3 - f^2 + f^3/2, the
mirrored one, and f^3/6 (de Boor, A practical guide to splines, 1978).
"""

from typing import Any

import numpy as np

from omnisight.models._elementwise import elementwise, span_index
from omnisight.models._projector import Array

# Coefficients of f^0 ... f^3 on a span, from its four control values.
TO_POWERS = np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6


@elementwise
def weights(f: Any) -> Any:
    """Return the weights of the four control values around a position in a span."""
    e = 1.0 - f
    e2, f2 = e * e, f * f
    sixth, middle = 0.16666666666666666667, 0.66666666666666666667
    return sixth * e2 * e, middle + f2 * (0.5 * f - 1.0), middle + e2 * (0.5 * e - 1.0), sixth * f2 * f


@elementwise
def slopes(f: Any) -> Any:
    """Return the derivatives of `weights`, per span."""
    e = 1.0 - f
    return -0.5 * e * e, f * (1.5 * f - 2.0), e * (2.0 - 1.5 * e), 0.5 * f * f


@elementwise
def blend(values: Any, i: Any, w: Any) -> Any:
    """Return the sum of w (four) times values[i : i + 4]."""
    return w[0] * values[i] + w[1] * values[i + 1] + w[2] * values[i + 2] + w[3] * values[i + 3]


@elementwise
def blend_row(values: Any, j: Any, i: Any, w: Any) -> Any:
    """Return the sum of w (four) times values[j, i : i + 4]."""
    return w[0] * values[j, i] + w[1] * values[j, i + 1] + w[2] * values[j, i + 2] + w[3] * values[j, i + 3]


@elementwise
def blend_patch(values: Any, j: Any, i: Any, across: Any, down: Any) -> Any:
    """Return the sum of down (four) times across (four) times values[j : j + 4, i : i + 4]."""
    top = down[0] * blend_row(values, j, i, across) + down[1] * blend_row(values, j + 1, i, across)
    return top + down[2] * blend_row(values, j + 2, i, across) + down[3] * blend_row(values, j + 3, i, across)


def basis(position: Array, spans: int) -> Array:
    """Return the weight of every control value at positions (N,) of a spline, (spans + 3, N)."""
    i, points = span_index(position, spans), np.arange(len(position))
    result = np.zeros((spans + 3, len(position)))
    for k, weight in enumerate(weights(position - i)):
        result[i + k, points] = weight
    return result
