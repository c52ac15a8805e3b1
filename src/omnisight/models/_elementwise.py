"""Building blocks of elementwise formulas, which run on NumPy arrays and, compiled by numba, on scalars.

A formula uses `where` in place of `if`, and `atan2` and `sine_cosine`, which compile to vectorizable code
(`_simd_math`). A function that it calls is decorated in the file that defines it:

- `elementwise` for a helper function,
- `model_method` for a function that each camera model implements as a static method of the same name. It takes the
  parameters `m` first; `m.model` is the class of the model. numba resolves the method at compile time.

Iterative formulas run a fixed number of Newton steps, and up to `max_iterations` more. A result of inf means that they
did not converge. The compiled loop runs all points with `FIXED_STEPS`, which vectorizes, and repeats the few that have
not converged with `MAX_ITERATIONS`.
"""

from collections.abc import Callable
from functools import wraps
from typing import Any

import numpy as np

FIXED_STEPS, MAX_ITERATIONS = None, 60

# Functions that `_kernels` makes known to numba before it compiles.
ELEMENTWISE: list[Callable[..., Any]] = []
MODEL_METHODS: list[Callable[..., Any]] = []


def elementwise(function: Callable[..., Any]) -> Callable[..., Any]:
    """Declare a function that compiled formulas call; it is inlined."""
    ELEMENTWISE.append(function)
    return function


def model_method(declaration: Callable[..., Any]) -> Callable[..., Any]:
    """Declare a function that calls the static method of its name of the model `m.model`."""

    @wraps(declaration)
    def call(m: Any, *arguments: Any) -> Any:
        return getattr(m.model, declaration.__name__)(m, *arguments)

    MODEL_METHODS.append(call)
    return call


def where(condition: Any, a: Any, b: Any) -> Any:
    """Return `a` where the condition holds, else `b`."""
    return np.where(condition, a, b)


def has_converged(step: Any, limit: Any) -> Any:
    """Return whether all steps of an iteration are at most `limit`; False if compiled, where the count is fixed."""
    return np.all(np.abs(step) <= limit)


def span_index(position: Any, count: Any) -> Any:
    """Return the index, 0 to count - 1, of the unit span that contains a position; the outer two are unbounded."""
    return np.where(position > 0.0, np.where(position < count - 1.0, position, count - 1.0), 0.0).astype(np.intp)


def atan2(y: Any, x: Any) -> Any:
    """Return the angle of (x, y) for y >= 0, in [0, pi] (radians)."""
    return np.arctan2(y, x)


def sine_cosine(angle: Any) -> Any:
    """Return (sin, cos) of an angle in [0, pi]."""
    return np.sin(angle), np.cos(angle)


@model_method
def project_point(m: Any, x: Any, y: Any, z: Any, max_iterations: Any) -> Any:
    """Return (u, v, valid) of a point in the camera frame."""


@model_method
def unproject_pixel(m: Any, u: Any, v: Any, max_iterations: Any) -> Any:
    """Return (x, y, z, valid), the unit bearing of a pixel."""
