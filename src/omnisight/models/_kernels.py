"""The compiled loops over points and pixels: one source for all models, which numba resolves at compile time.

Imported on first use only, because importing numba takes a quarter of a second. Compiled code is cached in the user's
cache folder under a hash of the sources of all models.
"""

import inspect
from collections.abc import Callable
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core.compiler import Compiler
from numba.extending import overload, register_jitable

from omnisight.cache import cache_folder
from omnisight.compiled import cached_njit, source_hash
from omnisight.models import _elementwise, _simd_math
from omnisight.models._elementwise import FIXED_STEPS, MAX_ITERATIONS, project_point, unproject_pixel

# Divisions by zero return inf, as in numpy; a fused multiply-add may round once instead of twice.
OPTIONS: Any = {"error_model": "numpy", "fastmath": {"contract", "nsz", "arcp"}}
# A loop vectorizes only if all functions that it calls are inlined.
INLINED: Any = {**OPTIONS, "forceinline": True}
# Points per block: the five coordinate arrays of a block fit in the L1 cache.
BLOCK = 256


def _overload_building_blocks() -> None:
    """Provide the scalar versions of the functions of `_elementwise`."""

    @overload(_elementwise.where, jit_options=INLINED)
    def _where(condition: Any, a: Any, b: Any) -> Any:  # pyright: ignore[reportUnusedFunction]
        def choose(condition: Any, a: Any, b: Any) -> Any:
            return a if condition else b

        return choose

    @overload(_elementwise.span_index, jit_options=INLINED)
    def _span_index(position: Any, count: Any) -> Any:  # pyright: ignore[reportUnusedFunction]
        def span(position: Any, count: Any) -> Any:
            # 32 bits: vector units convert only these several at a time.
            return np.int32(min(position, count - 1.0) if position > 0.0 else 0.0)

        return span

    @overload(_elementwise.any_of, jit_options=INLINED)
    def _any_of(condition: Any) -> Any:  # pyright: ignore[reportUnusedFunction]
        def always(condition: Any) -> Any:
            return True

        return always

    @overload(_elementwise.has_derivatives, jit_options=INLINED)
    def _has_derivatives(x: Any) -> Any:  # pyright: ignore[reportUnusedFunction]
        def never(x: Any) -> Any:
            return False

        return never

    @overload(_elementwise.without_gradient, jit_options=INLINED)
    def _without_gradient(x: Any) -> Any:  # pyright: ignore[reportUnusedFunction]
        def same(x: Any) -> Any:
            return x

        return same

    @overload(_elementwise.rounding, jit_options=INLINED)
    def _rounding(x: Any) -> Any:  # pyright: ignore[reportUnusedFunction]
        def of_float64(x: Any) -> Any:
            return 2.220446049250313e-16

        return of_float64

    for name in ("sqrt", "absolute", "arcsinh", "cosh", "tanh"):
        _overload_function_of_numpy(getattr(_elementwise, name), getattr(np, name))

    formulas = (_simd_math.atan2, _simd_math.sine_cosine, _simd_math.signed_atan2, _simd_math.signed_sine_cosine)
    for formula in formulas:
        plain = getattr(_elementwise, formula.__name__)
        overload(plain, jit_options=INLINED)(_with_signature(plain, lambda *_, formula=formula: formula))


def _overload_function_of_numpy(function: Callable[..., Any], of_numpy: Any) -> None:
    def resolve(x: Any) -> Any:
        def call(x: Any) -> Any:
            return of_numpy(x)

        return call

    overload(function, jit_options=INLINED)(resolve)


@cache
def _register_function(function: Callable[..., Any]) -> None:
    register_jitable(**INLINED)(function)


@cache
def _register_method(method: Callable[..., Any]) -> None:
    of_model = attrgetter(f"instance_class.model.{method.__name__}")
    overload(method, jit_options=INLINED)(_with_signature(method, lambda m, *_: of_model(m)))


def _with_signature(function: Callable[..., Any], resolve: Any) -> Any:
    """Return `resolve` with the signature of the function that it overloads, which numba requires."""
    resolve.__signature__ = inspect.signature(function)
    return resolve


class NoAliasCompiler(Compiler):
    """Compiles functions whose arguments do not overlap; otherwise loops that read tables do not vectorize."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.state.flags.noalias = True  # pyright: ignore[reportAttributeAccessIssue]


_overload_building_blocks()
FOLDER = cache_folder() / f"compiled-{source_hash(Path(__file__).parent, '*.py')}"


@numba.njit(**OPTIONS)
def _any_unconverged(values: Any) -> Any:
    # Counted first: the loop over the unconverged points vectorizes too, and would repeat all points under a mask.
    count = 0
    for value in values:
        count += np.abs(value) == np.inf
    return count > 0


@numba.njit(pipeline_class=NoAliasCompiler, **OPTIONS)
def _project_block(m: Any, x: Any, y: Any, z: Any, u: Any, v: Any) -> None:
    # One array per coordinate and no branch: this loop vectorizes. With interleaved coordinates it would not.
    for j in range(x.shape[0]):
        a, b, ok = project_point(m, x[j], y[j], z[j], FIXED_STEPS)
        u[j] = a if ok or np.abs(a) == np.inf else np.nan
        v[j] = b if ok else np.nan
    if not _any_unconverged(u):
        return
    for j in range(x.shape[0]):
        if np.abs(u[j]) == np.inf:
            a, b, ok = project_point(m, x[j], y[j], z[j], MAX_ITERATIONS)
            ok = ok and np.abs(a) != np.inf
            u[j] = a if ok else np.nan
            v[j] = b if ok else np.nan


@numba.njit(pipeline_class=NoAliasCompiler, **OPTIONS)
def _unproject_block(m: Any, u: Any, v: Any, x: Any, y: Any, z: Any) -> None:
    for j in range(u.shape[0]):
        a, b, c, ok = unproject_pixel(m, u[j], v[j], FIXED_STEPS)
        x[j] = a if ok or np.abs(a) == np.inf else np.nan
        y[j] = b if ok else np.nan
        z[j] = c if ok else np.nan
    if not _any_unconverged(x):
        return
    for j in range(u.shape[0]):
        if np.abs(x[j]) == np.inf:
            a, b, c, ok = unproject_pixel(m, u[j], v[j], MAX_ITERATIONS)
            ok = ok and np.abs(a) != np.inf
            x[j] = a if ok else np.nan
            y[j] = b if ok else np.nan
            z[j] = c if ok else np.nan


def project(m: Any, points: Any, pixels: Any, valid: Any, first: int, last: int) -> None:
    """Fill rows first to last of pixels (N, 2) and valid (N,) from points (N, 3); NaN where not valid."""
    planes = np.empty((5, BLOCK))
    for start in range(first, last, BLOCK):
        size = min(BLOCK, last - start)
        x, y, z, u, v = planes[0, :size], planes[1, :size], planes[2, :size], planes[3, :size], planes[4, :size]
        points_in, pixels_out = points[start : start + size], pixels[start : start + size]
        valid_out = valid[start : start + size]
        for j in range(size):
            x[j], y[j], z[j] = points_in[j, 0], points_in[j, 1], points_in[j, 2]
        _project_block(m, x, y, z, u, v)
        for j in range(size):
            pixels_out[j, 0], pixels_out[j, 1] = u[j], v[j]
            valid_out[j] = u[j] == u[j]


def unproject(m: Any, pixels: Any, bearings: Any, valid: Any, first: int, last: int) -> None:
    """Fill rows first to last of bearings (N, 3) and valid (N,) from pixels (N, 2); NaN where not valid."""
    planes = np.empty((5, BLOCK))
    for start in range(first, last, BLOCK):
        size = min(BLOCK, last - start)
        x, y, z, u, v = planes[0, :size], planes[1, :size], planes[2, :size], planes[3, :size], planes[4, :size]
        pixels_in, bearings_out = pixels[start : start + size], bearings[start : start + size]
        valid_out = valid[start : start + size]
        for j in range(size):
            u[j], v[j] = pixels_in[j, 0], pixels_in[j, 1]
        _unproject_block(m, u, v, x, y, z)
        for j in range(size):
            bearings_out[j, 0], bearings_out[j, 1], bearings_out[j, 2] = x[j], y[j], z[j]
            valid_out[j] = x[j] == x[j]


def map_view(target: Any, source: Any, rotation: Any, map_u: Any, map_v: Any, first: int, last: int) -> None:
    """Fill rows first to last of map_u, map_v (H, W) with the source pixel of each target pixel; NaN if there is none.

    `rotation` (3, 3) maps bearings of the target to the source frame.
    """
    columns = map_u.shape[1]
    r00, r01, r02 = rotation[0, 0], rotation[0, 1], rotation[0, 2]
    r10, r11, r12 = rotation[1, 0], rotation[1, 1], rotation[1, 2]
    r20, r21, r22 = rotation[2, 0], rotation[2, 1], rotation[2, 2]
    for row in range(first, last):
        us, vs = map_u[row], map_v[row]
        for column in range(columns):
            x, y, z, ok = unproject_pixel(target, float(column), float(row), FIXED_STEPS)
            a, b, c = r00 * x + r01 * y + r02 * z, r10 * x + r11 * y + r12 * z, r20 * x + r21 * y + r22 * z
            u, v, inside = project_point(source, a, b, c, FIXED_STEPS)
            column_u = u if ok & inside else np.nan
            us[column] = np.inf if (np.abs(x) == np.inf) | (np.abs(u) == np.inf) else column_u
            vs[column] = v if ok & inside else np.nan
        if not _any_unconverged(us):
            continue
        for column in range(columns):
            if us[column] == np.inf:
                x, y, z, ok = unproject_pixel(target, float(column), float(row), MAX_ITERATIONS)
                a, b, c = r00 * x + r01 * y + r02 * z, r10 * x + r11 * y + r12 * z, r20 * x + r21 * y + r22 * z
                u, v, inside = project_point(source, a, b, c, MAX_ITERATIONS)
                us[column] = u if ok & inside else np.nan
                vs[column] = v if ok & inside else np.nan


@cache
def compiled(loop: str, *models: str) -> Any:
    """Return one of the loops above (project, unproject, map_view), compiled for models by name.

    Each combination has its own folder: a process that needs one model does not read the index of all.
    """
    for function in _elementwise.ELEMENTWISE:
        _register_function(function)
    for method in _elementwise.MODEL_METHODS:
        _register_method(method)
    return cached_njit(globals()[loop], FOLDER / "-".join(models), nogil=True, **OPTIONS)
