"""Building blocks of elementwise formulas, which run on NumPy arrays, torch tensors and, compiled by numba, on scalars.

A formula uses `where` in place of `if`, and the functions below in place of those of NumPy. `atan2` and `sine_cosine`
compile to vectorizable code (`_simd_math`). A function that it calls is decorated in the file that defines it:

- `elementwise` for a helper function,
- `model_method` for a function that each camera model implements as a static method of the same name. It takes the
  parameters `m` first; `m.model` is the class of the model. numba resolves the method at compile time.

Iterative formulas run a fixed number of Newton steps, and up to `max_iterations` more. A result of inf means that they
did not converge. The compiled loop runs all points with `FIXED_STEPS`, which vectorizes, and repeats the few that have
not converged with `MAX_ITERATIONS`. Two steps follow `without_gradient`: the derivatives of two Newton steps that start
at the root are those of the root, up to the third, because a Newton step doubles the number of correct Taylor terms.
Iterations that have converged to rounding errors skip them unless the result `has_derivatives`.

A formula must have finite derivatives in its whole domain, in branches of `where` that are not selected too: automatic
differentiation multiplies them by zero.
"""

from collections.abc import Callable
from functools import wraps
from typing import Any

import numpy as np

FIXED_STEPS, MAX_ITERATIONS = None, 60

# Functions that `_kernels` makes known to numba before it compiles.
ELEMENTWISE: list[Callable[..., Any]] = []
MODEL_METHODS: list[Callable[..., Any]] = []


class NumpyFunctions:
    """The functions below for NumPy arrays."""

    where, sqrt, absolute, arcsinh, cosh, tanh = np.where, np.sqrt, np.absolute, np.arcsinh, np.cosh, np.tanh
    sin, cos, atan2, any = np.sin, np.cos, np.arctan2, np.any

    @staticmethod
    def signed_atan2(y: Any, x: Any) -> Any:
        return np.arctan2(y + 0.0, x)  # -0.0 + 0.0 is 0.0

    @staticmethod
    def as_index(x: Any) -> Any:
        return np.asarray(x).astype(np.intp)

    @staticmethod
    def has_derivatives(x: Any) -> bool:
        return False

    @staticmethod
    def without_gradient(x: Any) -> Any:
        return x

    @staticmethod
    def rounding(x: Any) -> float:
        return 2.220446049250313e-16


# The types of arrays of other libraries, and their functions: `omnisight.torch` adds its tensors.
LIBRARIES: dict[type, Any] = {}


def functions_of(x: Any) -> Any:
    """Return the functions of the library of an array."""
    for kind, functions in LIBRARIES.items():
        if isinstance(x, kind):
            return functions
    return NumpyFunctions


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
    return functions_of(condition).where(condition, a, b)


def sqrt(x: Any) -> Any:
    """Return the square root; its derivative at 0 is 0."""
    return functions_of(x).sqrt(x)


def absolute(x: Any) -> Any:
    """Return the absolute value."""
    return functions_of(x).absolute(x)


def arcsinh(x: Any) -> Any:
    """Return the inverse hyperbolic sine."""
    return functions_of(x).arcsinh(x)


def cosh(x: Any) -> Any:
    """Return the hyperbolic cosine."""
    return functions_of(x).cosh(x)


def tanh(x: Any) -> Any:
    """Return the hyperbolic tangent."""
    return functions_of(x).tanh(x)


def atan2(y: Any, x: Any) -> Any:
    """Return the angle of (x, y) for y >= 0, in [0, pi] (radians)."""
    return functions_of(y).atan2(y, x)


def signed_atan2(y: Any, x: Any) -> Any:
    """Return the angle of (x, y), in [-pi, pi] (radians); its derivatives at (0, 0) are 0."""
    return functions_of(y).signed_atan2(y, x)


def sine_cosine(angle: Any) -> Any:
    """Return (sin, cos) of an angle in [0, pi]."""
    functions = functions_of(angle)
    return functions.sin(angle), functions.cos(angle)


def signed_sine_cosine(angle: Any) -> Any:
    """Return (sin, cos) of an angle in [-pi, pi]."""
    functions = functions_of(angle)
    return functions.sin(angle), functions.cos(angle)


@elementwise
def clipped(x: Any, limit: Any) -> Any:
    """Return x limited to -limit to limit."""
    return where(x < limit, where(x > -limit, x, -limit), limit)


def span_index(position: Any, count: Any) -> Any:
    """Return the index, 0 to count - 1, of the unit span that contains a position; the outer two are unbounded."""
    functions = functions_of(position)
    inside = functions.where(position < count - 1.0, position, count - 1.0)
    return functions.as_index(functions.where(position > 0.0, inside, 0.0))


def any_of(condition: Any) -> Any:
    """Return whether a condition holds for any point; True in compiled loops, where the number of steps is fixed."""
    return functions_of(condition).any(condition)


def has_derivatives(x: Any) -> Any:
    """Return whether automatic differentiation passes through x."""
    return functions_of(x).has_derivatives(x)


def without_gradient(x: Any) -> Any:
    """Return x as a constant: derivatives do not pass through it."""
    return functions_of(x).without_gradient(x)


def rounding(x: Any) -> Any:
    """Return the relative rounding error of the floats of x: 2.2e-16 for float64."""
    return functions_of(x).rounding(x)


def table(values: Any) -> Any:
    """Return a tuple of numbers as an array; a tensor as it is."""
    return np.array(values) if isinstance(values, tuple) else values


@model_method
def project_point(m: Any, x: Any, y: Any, z: Any, max_iterations: Any) -> Any:
    """Return (u, v, valid) of a point in the camera frame."""


@model_method
def unproject_pixel(m: Any, u: Any, v: Any, max_iterations: Any) -> Any:
    """Return (x, y, z, valid), the unit bearing of a pixel."""
